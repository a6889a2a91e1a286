//! The bytes of a stream, and the scans in them.

/// Bytes of a stream as they come, which may end within a scan; scans are taken out whole. Its size
/// is fixed.
#[derive(Debug)]
pub struct ScanBytes {
    bytes: Vec<u8>,
    filled: usize,
    taken: usize,
    scan: usize,
    sample: usize,
}

impl ScanBytes {
    /// Room for `scans` of so many channels, and for the part of one more, in samples of 2 or 4
    /// bytes.
    pub fn new(channels: usize, sample_bytes: usize, scans: usize) -> Self {
        let scan = channels.max(1) * sample_bytes;
        let bytes = vec![0; (scans + 1) * scan];
        Self { bytes, filled: 0, taken: 0, scan, sample: sample_bytes }
    }

    /// Bytes of a scan.
    pub const fn scan_bytes(&self) -> usize {
        self.scan
    }

    /// Where the next bytes go; empty when it is full.
    pub fn space(&mut self) -> &mut [u8] {
        if self.taken > 0 {
            self.bytes.copy_within(self.taken..self.filled, 0);
            self.filled -= self.taken;
            self.taken = 0;
        }
        &mut self.bytes[self.filled..]
    }

    /// Tells how many bytes were put into [`ScanBytes::space`].
    pub fn filled(&mut self, bytes: usize) {
        self.filled = (self.filled + bytes).min(self.bytes.len());
    }

    /// Number of whole scans.
    pub fn scans(&self) -> usize {
        (self.filled - self.taken) / self.scan
    }

    /// The oldest whole scan: its codes, in the order of the channels.
    pub fn next_scan(&mut self) -> Option<impl Iterator<Item = u32>> {
        let bytes = self.bytes.get(self.taken..self.taken + self.scan)?;
        if self.taken + self.scan > self.filled {
            return None;
        }
        self.taken += self.scan;
        Some(bytes.chunks_exact(self.sample).map(code))
    }

    /// Drops what is there: after a gap the rest of a scan belongs to none.
    pub fn clear(&mut self) {
        self.filled = 0;
        self.taken = 0;
    }
}

/// A sample in the machine's byte order.
fn code(sample: &[u8]) -> u32 {
    match *sample {
        [a, b] => u32::from(u16::from_ne_bytes([a, b])),
        [a, b, c, d] => u32::from_ne_bytes([a, b, c, d]),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_full_buffer_has_no_space_and_the_rest_is_dropped_on_demand() {
        let mut bytes = ScanBytes::new(2, 4, 1);
        assert_eq!(bytes.space().len(), 16);
        bytes.filled(15);
        assert_eq!((bytes.scans(), bytes.space().len()), (1, 1));
        assert_eq!(bytes.next_scan().map(Iterator::count), Some(2));
        assert!(bytes.next_scan().is_none());
        bytes.clear();
        assert_eq!((bytes.scans(), bytes.space().len()), (0, 16));
    }

    proptest! {
        #[test]
        fn any_division_into_reads_gives_the_same_scans(
            channels in 1usize..=16,
            long in any::<bool>(),
            scans in 1usize..40,
            reads in prop::collection::vec(1usize..200, 1..400),
        ) {
            let sample = if long { 4 } else { 2 };
            let count = (scans * channels) as u32;
            let codes: Vec<u32> = (0..count).map(|i| i * 1_103 % 65_536).collect();
            let bytes_of = |code: &u32| match long {
                true => code.to_ne_bytes().to_vec(),
                false => (*code as u16).to_ne_bytes().to_vec(),
            };
            let stream: Vec<u8> = codes.iter().flat_map(bytes_of).collect();
            let mut bytes = ScanBytes::new(channels, sample, 3);
            let (mut found, mut at) = (Vec::new(), 0);
            for read in reads.iter().cycle() {
                let space = bytes.space();
                let read = (*read).min(space.len()).min(stream.len() - at);
                space[..read].copy_from_slice(&stream[at..at + read]);
                at += read;
                bytes.filled(read);
                while let Some(scan) = bytes.next_scan() {
                    found.extend(scan);
                }
                if at == stream.len() {
                    break;
                }
            }
            prop_assert_eq!(found, codes);
        }
    }
}
