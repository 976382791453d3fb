//! Data formats of commercial force/torque sensors, and a thread that reads one as a reference.
//!
//! - [`rdt`]: requests and records of ATI Net F/T boxes; [`page`]: the page with their units;
//! - [`ft300`]: frames of the Robotiq FT 300;
//! - [`lines`]: CSV and JSON lines from any program, with units in the names;
//! - [`ReferenceSource`]: a reference's location; [`open`](ReferenceSource::open) starts reading.
//!
//! The first four are pure. A sample carries the sensor's number or time, if sent, so that delayed
//! samples are not mistaken for new ones.
//!
//! ```
//! use reference_sensor::rdt::{RdtCommand, RdtRecord};
//!
//! assert_eq!(RdtCommand::Start(0).encode(), [0x12, 0x34, 0, 2, 0, 0, 0, 0]);
//! let record = RdtRecord { rdt_sequence: 7, counts: [1_000_000, 0, 0, 0, 0, 0], ..RdtRecord::default() };
//! assert_eq!(RdtRecord::decode_all(&record.encode()), Some(vec![record]));
//! ```

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "reads sockets, ports and programs, keeps time"
)]
#![forbid(unsafe_code)]

pub mod ft300;
pub mod lines;
pub mod page;
pub mod rdt;
mod reading;
mod source;

pub use source::{BadSource, ReferenceError, ReferenceSource};
