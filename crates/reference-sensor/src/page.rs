//! `netftapi2.xml`, the page on which a Net F/T box states its units and counts per unit.

use shell_data::escape::markup;
use shell_data::{Axis, PerAxis, Quantity, Scale, Unit};

#[derive(Clone, Debug, PartialEq)]
pub struct BoxSettings {
    /// Counts per unit of force (`cfgcpf`).
    pub counts_per_force: f64,
    /// Counts per unit of torque (`cfgcpt`).
    pub counts_per_torque: f64,
    /// The unit of force (`scfgfu`): `N`, `lbf`, `klbf`, `kN`, `kgf`.
    pub force_unit: String,
    /// The unit of torque (`scfgtu`): `N-m`, `N-mm`, `lbf-in`, `lbf-ft`, `kgf-cm`, `kN-m`.
    pub torque_unit: String,
}

impl BoxSettings {
    /// Returns 1 µN and 1 µN·m per count, up to ±2147 N and N·m in 32 bits.
    pub fn micro() -> Self {
        let (force_unit, torque_unit) = ("N".to_owned(), "N-m".to_owned());
        Self { counts_per_force: 1e6, counts_per_torque: 1e6, force_unit, torque_unit }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadPage {
    #[error("`netftapi2.xml` has no field `{0}`")]
    Missing(&'static str),
    #[error("`netftapi2.xml` has `{text}` in `{field}`, which is no number of counts")]
    Counts { field: &'static str, text: String },
    #[error("`netftapi2.xml` has the unit `{text}` in `{field}`, which is not understood")]
    Unit { field: &'static str, text: String },
}

pub fn write(settings: &BoxSettings, rate_hz: u32, product: &str) -> String {
    let BoxSettings { counts_per_force, counts_per_torque, force_unit, torque_unit } = settings;
    let fields = [
        ("prodname", product.to_owned()),
        ("runstat", "0x00000000".to_owned()),
        ("runrate", rate_hz.to_string()),
        ("setcfgsel", "0".to_owned()),
        ("cfgnam", product.to_owned()),
        ("cfgcalsel", "0".to_owned()),
        ("cfgcpf", counts_per_force.to_string()),
        ("cfgcpt", counts_per_torque.to_string()),
        ("scfgfu", force_unit.clone()),
        ("scfgtu", torque_unit.clone()),
        ("comrdte", "Enabled".to_owned()),
        ("comrdtrate", rate_hz.to_string()),
        ("comrdtbsiz", super::rdt::BUFFERED.to_string()),
    ];
    let fields = fields.map(|(name, text)| format!("<{name}>{}</{name}>\n", markup(&text)));
    format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<netft>\n{}</netft>\n", fields.concat())
}

/// Fails with [`BadPage`] if counts or units are missing or unusable.
pub fn read(page: &str) -> Result<BoxSettings, BadPage> {
    let counts = |name: &'static str| {
        let text = field(page, name).ok_or(BadPage::Missing(name))?;
        let counts = text.parse().ok().filter(|counts: &f64| counts.is_finite() && *counts > 0.0);
        counts.ok_or_else(|| BadPage::Counts { field: name, text: text.to_owned() })
    };
    let unit = |name: &'static str, quantity| {
        let text = field(page, name).ok_or(BadPage::Missing(name))?;
        match understood(text, quantity) {
            Some(_) => Ok(text.to_owned()),
            None => Err(BadPage::Unit { field: name, text: text.to_owned() }),
        }
    };
    Ok(BoxSettings {
        counts_per_force: counts("cfgcpf")?,
        counts_per_torque: counts("cfgcpt")?,
        force_unit: unit("scfgfu", Quantity::Force)?,
        torque_unit: unit("scfgtu", Quantity::Moment)?,
    })
}

fn field<'a>(page: &'a str, name: &str) -> Option<&'a str> {
    let opened = page.split_once(&format!("<{name}>"))?.1;
    Some(opened.split_once("</")?.0.trim())
}

/// Converts a box's unit to a scale; ATI's `klbf` is the kip.
fn understood(text: &str, quantity: Quantity) -> Option<Scale> {
    Unit::parse(text, quantity).map(|unit| unit.scale)
}

impl BoxSettings {
    /// Converts counts to N and N·m.
    pub fn wrench(&self, counts: [i32; 6]) -> PerAxis<f64> {
        let scales = [(&self.force_unit, Quantity::Force), (&self.torque_unit, Quantity::Moment)]
            .map(|(unit, quantity)| understood(unit, quantity).unwrap_or(Scale::ONE));
        Axis::ALL.map(|axis| {
            let (scale, per_unit) = match axis.is_moment() {
                false => (scales[0], self.counts_per_force),
                true => (scales[1], self.counts_per_torque),
            };
            // In this order, units that are powers of ten are rounded only once.
            f64::from(counts[axis.index()]) * scale.times / (scale.per * per_unit)
        })
    }

    /// Converts N and N·m to counts; also returns true if a value is NaN or out of range.
    pub fn counts(&self, wrench: &PerAxis<f64>) -> ([i32; 6], bool) {
        let mut beyond = false;
        let counts = Axis::ALL.map(|axis| {
            let per_unit = match axis.is_moment() {
                false => self.counts_per_force,
                true => self.counts_per_torque,
            };
            let counts = (wrench[axis.index()] * per_unit).round();
            beyond |= !(f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&counts);
            // The conversion saturates; NaN becomes 0.
            counts as i32
        });
        (counts, beyond)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_read_as_it_was_written() {
        let page = write(&BoxSettings::micro(), 1000, "a & b");
        assert_eq!(read(&page), Ok(BoxSettings::micro()));
        assert!(page.contains("<comrdtrate>1000</comrdtrate>") && page.contains("a &amp; b"));
    }

    #[test]
    fn every_unit_of_a_box_is_understood() {
        let page = |force: &str, torque: &str| {
            format!(
                "<netFTApi><cfgcpf> 1000 </cfgcpf><cfgcpt>10</cfgcpt><scfgfu>{force}</scfgfu>\
                 <scfgtu>{torque}</scfgtu></netFTApi>"
            )
        };
        for (force, torque, force_n, torque_nm) in [
            ("N", "N-m", 1.0, 1.0),
            ("kN", "N-mm", 1e3, 1e-3),
            ("lbf", "lbf-in", 4.448_221_615_260_5, 0.112_984_829_027_616_7),
            ("klbf", "lbf-ft", 4_448.221_615_260_5, 1.355_817_948_331_400_4),
            ("kgf", "kgf-cm", 9.806_65, 0.098_066_5),
            ("N", "kN-m", 1.0, 1e3),
        ] {
            let settings = read(&page(force, torque)).unwrap();
            let wrench = settings.wrench([1000, 0, 0, 0, 0, 10]);
            assert!((wrench[0] / force_n - 1.0).abs() < 1e-12, "{force}: {wrench:?}");
            assert!((wrench[5] / torque_nm - 1.0).abs() < 1e-12, "{torque}: {wrench:?}");
        }
        let unit = BadPage::Unit { field: "scfgtu", text: "N/m".to_owned() };
        assert_eq!(read(&page("N", "N/m")), Err(unit));
        assert_eq!(read("<cfgcpf>1</cfgcpf>"), Err(BadPage::Missing("cfgcpt")));
        assert!(matches!(read("<cfgcpf>0</cfgcpf>"), Err(BadPage::Counts { .. })));
    }

    #[test]
    fn counts_are_rounded_and_stop_at_their_ends() {
        let settings = BoxSettings::micro();
        let (counts, beyond) = settings.counts(&[1.25, -2e-6, 0.6e-6, 0.0, 2.0, -0.5]);
        assert_eq!((counts, beyond), ([1_250_000, -2, 1, 0, 2_000_000, -500_000], false));
        let (counts, beyond) = settings.counts(&[3000.0, f64::NAN, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!((counts[0], counts[1], beyond), (i32::MAX, 0, true));
    }
}
