//! Tables of loads: mass or force, its point and direction, and the resulting wrench.
//!
//! Each line is a pose: either a load that a rig can apply or a load that was applied, in the order
//! of the lines.
//!
//! | columns | meaning |
//! |---|---|
//! | `group` | the label of the pose, as in the group column of the log; by default 1, 2, 3 … |
//! | `mass_kg`, `mass_g`, `force_n` or `force_mn` | the load: a hanging mass, or a force |
//! | `x_mm`, `y_mm`, `z_mm` | the point of application, from the sensor's origin |
//! | `direction` | `down`, `up`, `+x`, `-x`, … `-z`, in the sensor's frame; `down` is −z |
//! | `dx`, `dy`, `dz` | or a vector of any length along the force |
//! | `azimuth_deg`, `elevation_deg` | or angles: from x towards y, and up from the plane of these |
//! | `roll_deg`, `pitch_deg`, `yaw_deg` | or the attitude of the sensor in the room, where the load pulls down |
//! | `ax`, `ay`, `az` | or the readings of an accelerometer on the still sensor, in any unit |
//! | `fx_n` … `mz_nm` | or the wrench itself, if no mass and no force is given |
//! | `mounting` | a label shared by the loads of one mounting of the lever |
//! | `mass_error_g`, `force_error_n`, `angle_error_deg`, `lever_error_mm` | standard errors; 0.2 %, 1° and 1 mm if absent |
//!
//! A line with a load needs all three coordinates and one whole direction, also where a number is 0; without any column
//! of directions, weights hang down. Other units of the same quantity are read: `x_in`, `Mass [lb]`. Columns `notes`,
//! `notes_…` and `plan_…` are copied unchanged. Frame: x forward, y left, z up.
//!
//! ```
//! use load_table::HungLoads;
//!
//! let table = HungLoads::parse("group,mass_kg,x_mm,y_mm,z_mm\nbow,0.5,30,0,40\n")?;
//! let wrench = table.loads()[0].wrench();
//! assert!((wrench[2] + 0.5 * 9.80665).abs() < 1e-12);
//! // r × F: x forward times a force down turns about +y.
//! assert!((wrench[4] - 0.03 * 0.5 * 9.80665).abs() < 1e-12);
//! # Ok::<_, load_table::HungLoadError>(())
//! ```

#![forbid(unsafe_code)]

mod columns;
mod load;
mod rig;
mod table;

pub use self::load::{HungLoad, Pull, STANDARD_GRAVITY};
pub use self::rig::{WrenchBox, combinations};
pub use self::table::{HungLoadError, HungLoads};
