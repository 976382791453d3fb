//! Quasi-static forces on an ellipse that pushes through a channel of springy beams.
//!
//! The model is from Koc et al., "Body Lift and Drag for a Legged Millirobot in Compliant Beam
//! Environment", "Quasi-static contact forces": a rigid body, elliptic from above, moves forward
//! between two rows of beams. Each is a bar of length `L` on a torsional spring, and its tip slides
//! along the body. Axes: x forward, y left; SI units throughout.
//!
//! ```
//! use beam_channel::{Model, Setup};
//!
//! let mut setup = Setup::default();
//! setup.channel.width_m = 0.06; // 2 cm of deflection
//! let model = Model::new(&setup)?;
//!
//! let total = model.total(0.1); // the body's middle 10 cm past the first beam
//! assert_eq!(total.contacts, [6, 6]);
//! assert!((-total.fx_n - 0.217349).abs() < 1e-6);
//!
//! let plateau = model.plateau().expect("the channel is longer than the body");
//! assert!((plateau.mean_drag_n - 0.217083).abs() < 1e-6);
//! # Ok::<(), beam_channel::SetupError>(())
//! ```
//!
//! # Solution
//!
//! Let `φ` be the position of a beam's tip on the ellipse, and `φ_e` that of the first touch. With
//! `sin((φ − φ_e)/2) = z²` all functions are algebraic in `z`, free of cancellation, and smooth at
//! the first touch, unlike in `φ`. The body's travel since it touched the beam, `s(z)`, rises with
//! `z` until the beam slips off: a contact is one root of `s(z) = s`, by a bracketed Newton
//! iteration ([`Side`]). Integrals over the body's path are integrals over `z` ([`Model::energy`]).
//!
//! The crate allocates no memory and needs no standard library. With the functions of `libm`,
//! results have the same bits on every machine.
#![no_std]
#![forbid(unsafe_code)]

mod arc;
mod bending;
mod bisection;
mod elastica;
mod force;
mod model;
mod path;
mod plateau;
mod quadrature;
mod setup;
mod side;

pub use force::BeamForce;
pub use model::{Model, Total};
pub use path::Contact;
pub use plateau::{BeamPlateau, Extreme};
pub use setup::{Angle, Beam, Channel, Ellipse, Normal, Pose, Rules, Setup, SetupError, Wall};
pub use side::Side;
