//! The control process and its laws.
