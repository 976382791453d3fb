//! Comparison with a reference solution in 40-digit arithmetic, printed to 15 digits.

use beam_channel::{Angle, Model, Normal, Rules, Setup, Wall};

use crate::closeness::assert_close;

struct Reference {
    semi_width_m: f64,
    width_m: f64,
    phi_e: f64,
    u_e: f64,
    phi_f: f64,
    u_f: f64,
    mean_drag: f64,
    energy_crossing_j: f64,
    peak: f64,
    minimum: f64,
    contacts: [u32; 2],
    /// Position, F_drag, beams in contact per side.
    totals: &'static [(f64, f64, u32)],
}

const REFERENCES: [Reference; 6] = [
    Reference {
        semi_width_m: 0.05,
        width_m: 0.08,
        phi_e: 0.927295218001612,
        u_e: 0.054,
        phi_f: 2.15651600615654,
        u_f: -0.0590886561661408,
        mean_drag: 0.108734173433852,
        energy_crossing_j: 0.0304455685614785,
        peak: 0.111822637901606,
        minimum: 0.10570012052088,
        contacts: [4, 5],
        totals: &[
            (-0.05, -0.00702387648674651, 1),
            (0.0, -0.068625661996187, 3),
            (0.05, -0.109028518037253, 5),
            (0.1, -0.108027904215598, 5),
            (0.14, -0.10775878987026, 4),
            (0.18, -0.111084157272534, 5),
            (0.22, -0.108101978684278, 4),
            (0.26, -0.0672051857331116, 3),
            (0.3, -0.0173115251262085, 1),
            (0.34, 0.0, 0),
        ],
    },
    Reference {
        semi_width_m: 0.05,
        width_m: 0.06,
        phi_e: 0.643501108793284,
        u_e: 0.072,
        phi_f: 2.39713813460982,
        u_f: -0.080133851152808,
        mean_drag: 0.21708288510962,
        energy_crossing_j: 0.0607832078306936,
        peak: 0.2208980351056,
        minimum: 0.208232176342079,
        contacts: [5, 6],
        totals: &[
            (-0.05, -0.0356075936549079, 1),
            (0.0, -0.139363350290871, 3),
            (0.05, -0.211110403781611, 5),
            (0.1, -0.217349097902083, 6),
            (0.14, -0.219965534082441, 6),
            (0.18, -0.212694765795989, 6),
            (0.22, -0.198234144792425, 5),
            (0.26, -0.116248733848979, 3),
            (0.3, -0.0421829732432685, 2),
            (0.34, 0.0, 0),
        ],
    },
    Reference {
        semi_width_m: 0.05,
        width_m: 0.04,
        phi_e: 0.411516846067488,
        u_e: 0.0824863625092051,
        phi_f: 2.57783396439855,
        u_f: -0.0938956008077225,
        mean_drag: 0.305874279216731,
        energy_crossing_j: 0.0856447981806846,
        peak: 0.310132163311934,
        minimum: 0.292582648748931,
        contacts: [6, 7],
        totals: &[
            (-0.05, -0.0748725201547083, 2),
            (0.0, -0.211585583892601, 4),
            (0.05, -0.295264595319012, 6),
            (0.1, -0.308697846654257, 7),
            (0.14, -0.302717296506676, 7),
            (0.18, -0.310029561903644, 7),
            (0.22, -0.25066045720062, 6),
            (0.26, -0.148186133848877, 4),
            (0.3, -0.0574700796034283, 2),
            (0.34, -0.00188385929579153, 1),
        ],
    },
    Reference {
        semi_width_m: 0.055,
        width_m: 0.08,
        phi_e: 0.814339942126525,
        u_e: 0.0617713726522152,
        phi_f: 2.25016630374334,
        u_f: -0.0684968563491989,
        mean_drag: 0.157769174648912,
        energy_crossing_j: 0.0441753689016953,
        peak: 0.160725111826088,
        minimum: 0.152727214100426,
        contacts: [5, 6],
        totals: &[],
    },
    Reference {
        semi_width_m: 0.055,
        width_m: 0.06,
        phi_e: 0.576931345236457,
        u_e: 0.07543263646876,
        phi_f: 2.44656120451931,
        u_f: -0.085083650206759,
        mean_drag: 0.259985267887742,
        energy_crossing_j: 0.0727958750085678,
        peak: 0.263893235403165,
        minimum: 0.254825515952729,
        contacts: [6, 7],
        totals: &[],
    },
    Reference {
        semi_width_m: 0.055,
        width_m: 0.04,
        phi_e: 0.372168533960326,
        u_e: 0.083838688085124,
        phi_f: 2.60425810927112,
        u_f: -0.0966491815251532,
        mean_drag: 0.303291858884217,
        energy_crossing_j: 0.0849217204875808,
        peak: 0.311473812270834,
        minimum: 0.287361619286759,
        contacts: [7, 8],
        totals: &[],
    },
];

fn setup(semi_width_m: f64, width_m: f64) -> Setup {
    let mut setup = Setup::default();
    setup.ellipse.semi_width_m = semi_width_m;
    setup.channel.width_m = width_m;
    setup
}

#[test]
fn the_constants_of_the_paper_give_its_stiffness() {
    assert_close("k_t", Setup::default().beam.torsional_stiffness(), 8.48e-4);
}

#[test]
fn drag_equals_the_reference_solution() {
    for reference in &REFERENCES {
        let model = Model::new(&setup(reference.semi_width_m, reference.width_m)).unwrap();
        let side = model.side(Wall::Left).unwrap();
        assert_close("phi_e", side.first_touch_rad, reference.phi_e);
        assert_close("u_e", side.engagement_m, reference.u_e);
        assert_close("u_f", side.release_m(), reference.u_f);
        let release = side.contact_after(side.travel_m()).unwrap();
        assert_close("phi_f", side.place_rad(&release), reference.phi_f);
        assert_close("energy", model.energy(), reference.energy_crossing_j);
        let plateau = model.plateau().unwrap();
        assert_close("mean", plateau.mean_drag_n, reference.mean_drag);
        assert_close("peak", plateau.peak.drag_n, reference.peak);
        assert_close("minimum", plateau.minimum.drag_n, reference.minimum);
        let [least, greatest] = reference.contacts;
        assert_eq!((plateau.min_contacts, plateau.max_contacts), ([least; 2], [greatest; 2]));
        for &(x_m, force, contacts) in reference.totals {
            let total = model.total(x_m);
            assert_close(&format!("F_drag at {x_m} m"), total.fx_n, force);
            assert_eq!(total.contacts, [contacts; 2], "at {x_m} m");
            assert_eq!((total.fy_n, total.mz_nm), (0.0, 0.0), "two equal sides");
        }
    }
}

/// Expected: an independent quadrature over the position of the tip (numpy, 400 Gauss–Legendre nodes), which reproduces
/// the figures above for the paper's force.
#[test]
fn forces_that_balance_their_springs_have_the_means_of_an_independent_computation() {
    for (width_m, expected) in
        [(0.08, 0.100_279_455_449), (0.06, 0.197_335_571_349), (0.04, 0.332_538_541_772)]
    {
        let mut setup = Setup::default();
        setup.channel.width_m = width_m;
        setup.rules = Rules { angle: Angle::True, normal: Normal::MomentBalance };
        let plateau = Model::new(&setup).unwrap().plateau().unwrap();
        // The quadrature had a stiffness of 8.48·10⁻⁴ N·m/rad, and gives twelve digits.
        assert!((plateau.mean_drag_n / expected - 1.0).abs() < 1e-10, "{plateau:?}");
        let (low, high) = (plateau.minimum.drag_n, plateau.peak.drag_n);
        assert!(low < plateau.mean_drag_n && plateau.mean_drag_n < high, "{plateau:?}");
        // Checks the extremes, which are roots of the slope, against the drag.
        let model = Model::new(&setup).unwrap();
        for step in 0..400 {
            let x = plateau.extent_m[0] + f64::from(step) / 400.0 * setup.channel.pitch_m;
            let drag = -model.total(x).fx_n;
            assert!((low - 1e-12..=high + 1e-12).contains(&drag), "{x}: {drag} {low} {high}");
        }
    }
}

#[test]
fn a_body_that_friction_holds_is_refused() {
    let rules = Rules { angle: Angle::True, normal: Normal::MomentBalance };
    let mut setup = Setup { rules, ..Setup::default() };
    setup.beam.friction = 0.0;
    let error = Model::new(&setup).unwrap_err();
    assert!(error.to_string().contains("friction coefficient is 0"), "{error}");
}
