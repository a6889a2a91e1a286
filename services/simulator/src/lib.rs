//! The virtual card: plant, scan FIFO, DACs that hold, enable line.
