//! Tables of loads: mass or force, its point and direction, and the resulting wrench.
//!
//! Each line is a pose: either a load that a rig can apply or a load that was applied, in the order
//! of the lines.
//!
//! | columns | meaning |
//! |---|---|
//! | `group` | the label of the pose, as in the group column of the log; by default the line number |
//! | `mass_kg`, `mass_g`, `force_n` or `force_mn` | the load: a hanging mass, or a force |
//! | `x_mm`, `y_mm`, `z_mm` (or `_cm`, `_m`) | the point of application, from the sensor's origin; 0 if absent |
//! | `direction` | `down`, `up`, `+x`, `-x`, … `-z`, in the sensor's frame; `down` is −z and the default |
//! | `dx`, `dy`, `dz` | or a vector of any length along the force |
//! | `azimuth_deg`, `elevation_deg` | or angles: from x towards y, and up from the plane of these |
//! | `roll_deg`, `pitch_deg`, `yaw_deg` | or the attitude of the sensor in the room, where the load pulls down |
//! | `ax`, `ay`, `az` | or the readings of an accelerometer on the still sensor, in any unit |
//! | `fx_n` … `mz_nm` | or the wrench itself, if no mass and no force is given |
//! | `mounting` | a label shared by the loads of one mounting of the lever |
//! | `mass_error_g` (or `_kg`), `force_error_n` (or `_mn`), `angle_error_deg` (or `_rad`), `lever_error_mm` (or `_cm`, `_m`) | standard errors; 0.2 %, 1° and 1 mm if absent |
//!
//! `notes` and `plan_…` columns are copied unchanged. Frame: x forward, y left, z up.
//!
//! ```
//! use load_table::HungLoads;
//!
//! let table = HungLoads::parse("group,mass_kg,x_mm,z_mm,direction\nbow,0.5,30,40,down\n")?;
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
