//! The wire protocol between the SkinProc board and `shellcal`, used by both ends.
#![no_std]
#![forbid(unsafe_code)]
