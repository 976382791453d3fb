//! A guide through the loads of a table.

use live_view::{Guide, GuidedLoad};
use load_table::{HungLoad, HungLoads};

/// A guide through the loads of a table, in its order. What each is expected to tell is in its column `plan_gain_nats`,
/// which `shellcal plan` writes; a table without it counts loads.
pub fn guide_through(table: &HungLoads) -> Guide {
    let gains: Vec<f64> = match table.column("plan_gain_nats") {
        Some(cells) => cells.map(|cell| cell.parse().unwrap_or(0.0)).collect(),
        None => vec![0.0; table.loads().len()],
    };
    let guided = |(load, gain): (&HungLoad, f64)| GuidedLoad {
        group: load.group.clone(),
        text: load.to_string(),
        wrench: load.wrench(),
        gain,
    };
    Guide::new(table.loads().iter().zip(gains).map(guided).collect())
}
