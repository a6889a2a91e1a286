//! Reading and writing of recordings: MCAP and CSV.
