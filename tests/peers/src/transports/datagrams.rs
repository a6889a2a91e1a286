//! Unix datagram sockets.

use std::io::ErrorKind;
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;

use ipc_types::{Message as _, Sample};
use runtime::clock::now_ns;

use crate::{Failure, Publish, Read};

fn path(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("{name}.socket"))
}

pub(crate) fn publisher(name: &str) -> Result<Publish, Failure> {
    let socket = UnixDatagram::unbound()?;
    socket.connect(path(name))?;
    socket.set_nonblocking(true)?;
    let mut sequence = 0;
    Ok(Box::new(move |mut sample: Sample| {
        sample.stamp(1, 1, sequence, now_ns());
        sequence += 1;
        match socket.send(sample.as_bytes()) {
            // A reader that is not there, or slow, loses the message.
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(()),
            sent => Ok(sent.map(drop)?),
        }
    }))
}

pub(crate) fn reader(name: &str) -> Result<Read, Failure> {
    let socket = UnixDatagram::bind(path(name))?;
    socket.set_nonblocking(true)?;
    let mut bytes = [0; size_of::<Sample>()];
    Ok(Box::new(move || {
        let mut length = None;
        loop {
            match socket.recv(&mut bytes) {
                Ok(received) => length = Some(received),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) => return Err(error.into()),
            }
        }
        Ok(length.and_then(|length| Sample::from_bytes(bytes.get(..length)?)))
    }))
}
