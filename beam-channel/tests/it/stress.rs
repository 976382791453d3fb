//! Geometries at the limits of the model: results or a named error, never a panic or NaN.
use beam_channel::{Angle, Model, Normal, Pose, Rules, Setup, SetupError, Wall};
use proptest::prelude::*;

fn check(setup: &Setup) -> Result<Model, SetupError> {
    let model = Model::new(setup)?;
    let finite = |what: &str, value: f64| assert!(value.is_finite(), "{what}: {value}, {setup:?}");
    finite("energy", model.energy());
    if let Some(plateau) = model.plateau() {
        finite("mean", plateau.mean_drag_n);
        let (least, greatest) = (plateau.minimum.drag_n, plateau.peak.drag_n);
        // The mean of rounded values may be off by its own rounding error.
        let slack = 1e-9 * greatest.abs().max(least.abs());
        assert!(least - slack <= plateau.mean_drag_n, "{plateau:?} {setup:?}");
        assert!(plateau.mean_drag_n <= greatest + slack, "{plateau:?} {setup:?}");
    }
    let Some([first, last]) = model.extent_m() else { return Ok(model) };
    assert!(first < last);
    for i in 0..=40 {
        let x = first + (last - first) * f64::from(i) / 40.0;
        for wall in Wall::BOTH {
            let touching = model.touching(wall, x);
            assert_eq!(model.beams(wall, x).count(), touching.len(), "{setup:?} at {x}");
            for (beam, contact, force) in model.beams(wall, x) {
                assert!(touching.contains(&beam));
                for value in [force.fx_n, force.fy_n, force.mz_nm, force.deflection_rad] {
                    finite("force", value);
                }
                assert!(force.deflection_rad >= 0.0 && contact.reach_m >= 0.0);
            }
        }
        // Beams solved together give the same bits as each alone.
        let of_wall = |wall| model.beams(wall, x).map(|(_, _, force)| force.fx_n);
        let sum = if setup.pose == Pose::default() {
            2.0 * of_wall(Wall::Left).fold(0.0, |sum, fx| sum + fx)
        } else {
            Wall::BOTH.into_iter().flat_map(of_wall).fold(0.0, |sum, fx| sum + fx)
        };
        assert_eq!(model.total(x).fx_n, sum, "{setup:?} at {x}");
    }
    assert_eq!(model.total(first - 1.0), model.total(last + 1.0));
    Ok(model)
}

fn with(change: impl FnOnce(&mut Setup)) -> Setup {
    let mut setup = Setup::default();
    change(&mut setup);
    setup
}

#[test]
fn a_body_that_grazes_the_tips_hardly_feels_them() {
    let mut last = f64::INFINITY;
    for depth in [1e-3, 1e-5, 1e-8, 1e-12, 1e-16] {
        let model = check(&with(|setup| setup.channel.width_m = 0.1 - 2.0 * depth)).unwrap();
        let energy = model.energy();
        assert!(energy < last && energy >= 0.0, "{depth}: {energy}");
        last = energy;
    }
}

#[test]
fn a_channel_wider_than_the_body_has_no_contact() {
    for width in [0.1, 0.1 + 1e-15, 0.2] {
        let model = check(&with(|setup| setup.channel.width_m = width)).unwrap();
        assert_eq!((model.extent_m(), model.plateau()), (None, None));
        assert_eq!(model.energy(), 0.0);
        assert_eq!(model.total(0.1).contacts, [0, 0]);
    }
}

#[test]
fn a_body_deeper_than_the_beam_length_has_finite_forces() {
    // d from just below L = 27 mm to just below 2L; the body is large enough for both.
    for depth in [0.027 - 1e-12, 0.027, 0.027 + 1e-12, 0.04, 0.0539, 0.054 - 1e-9, 0.054 - 1e-15] {
        for angle in [Angle::Folded, Angle::True] {
            let model = check(&with(|setup| {
                setup.ellipse.semi_width_m = 0.08;
                setup.channel.width_m = 2.0 * (0.08 - depth);
                setup.rules.angle = angle;
            }));
            let model = model.unwrap();
            let side = model.side(Wall::Left).unwrap();
            // Nearer to the limit than rounding can resolve, either answer is right.
            if (depth - 0.027).abs() > 1e-15 {
                assert_eq!(side.turns_past_a_right_angle(), depth > 0.027, "{depth}");
            }
        }
    }
}

#[test]
fn a_body_that_jams_is_refused() {
    for depth in [0.054 + 1e-15, 0.06, 0.079] {
        let error = check(&with(|setup| {
            setup.ellipse.semi_width_m = 0.08;
            setup.channel.width_m = 2.0 * (0.08 - depth);
        }));
        assert!(matches!(error, Err(SetupError::Jams { wall: Wall::Left, .. })), "{error:?}");
    }
    let aside = with(|setup| setup.pose.offset_m = -0.04);
    let error = check(&aside).unwrap_err();
    assert!(matches!(error, SetupError::BeyondTips { wall: Wall::Right, .. }), "{error:?}");
    let text = "the body's middle lies -40.00 mm off the channel's and so beyond the tips of the \
                right beams, which are 40.00 mm off it";
    assert_eq!(error.to_string(), text);
}

#[test]
fn invalid_quantities_are_named() {
    type Case = (&'static str, fn(&mut Setup));
    let cases: [Case; 8] = [
        ("semi-length", |setup| setup.ellipse.semi_length_m = f64::NAN),
        ("semi-width", |setup| setup.ellipse.semi_width_m = 0.0),
        ("length", |setup| setup.beam.length_m = -1.0),
        ("modulus", |setup| setup.beam.flexural_modulus_pa = f64::INFINITY),
        ("friction", |setup| setup.beam.friction = -0.1),
        ("channel's width", |setup| setup.channel.width_m = 0.0),
        ("number of beams", |setup| setup.channel.beams = 0),
        ("yaw", |setup| setup.pose.yaw_rad = 2.0),
    ];
    for (name, change) in cases {
        let error = check(&with(change)).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
    }
}

#[test]
fn a_nan_position_has_no_contact() {
    let model = Model::new(&Setup::default()).unwrap();
    for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
        assert_eq!(model.total(x).contacts, [0, 0]);
    }
}

/// Beyond what a person might type.
fn setups() -> impl Strategy<Value = Setup> {
    let decades = |low: f64, high: f64| (low.log10()..high.log10()).prop_map(|x| 10_f64.powf(x));
    let rules = prop::sample::select(vec![
        Rules::default(),
        Rules { normal: Normal::AsPrinted, angle: Angle::True },
        Rules { normal: Normal::MomentBalance, angle: Angle::True },
    ]);
    let shape = (decades(1e-3, 1.0), decades(0.02, 50.0), decades(0.02, 50.0), 0.0..1.2_f64);
    let pose = (-0.6..0.6_f64, -1.5..1.5_f64, any::<bool>());
    (shape, 0.0..5.0_f64, decades(0.02, 2.0), 1..40_u32, pose, rules).prop_map(
        |((width, slender, beam, gap), friction, pitch, beams, (offset, yaw, middle), rules)| {
            let mut setup = Setup { rules, ..Setup::default() };
            setup.ellipse.semi_width_m = width;
            setup.ellipse.semi_length_m = width * slender;
            setup.beam.length_m = width * beam;
            setup.beam.friction = friction;
            setup.channel.width_m = (2.0 * width * gap).max(1e-6);
            setup.channel.beams = beams;
            setup.channel.pitch_m = width * slender * pitch;
            if !middle {
                let offset_m = 0.5 * setup.channel.width_m * offset;
                setup.pose = Pose { offset_m, yaw_rad: yaw };
            }
            setup
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn random_setups_give_finite_numbers(setup in setups()) {
        if let Err(error) = check(&setup) {
            prop_assert!(!error.to_string().contains("NaN"));
        }
    }

    #[test]
    fn a_mirrored_body_has_mirrored_forces(setup in setups(), position in 0.0..1.0_f64) {
        let mut mirrored = setup;
        mirrored.pose = Pose { offset_m: -setup.pose.offset_m, yaw_rad: -setup.pose.yaw_rad };
        let (Ok(one), Ok(other)) = (Model::new(&setup), Model::new(&mirrored)) else { return Ok(()) };
        let Some([first, last]) = one.extent_m() else { return Ok(()) };
        let x = first + (last - first) * position;
        let (one, other) = (one.total(x), other.total(x));
        // The two walls are summed in alternation.
        let size = one.fx_n.abs() + one.fy_n.abs() + 1e-300;
        prop_assert!((one.fx_n - other.fx_n).abs() <= 1e-9 * size, "{one:?} {other:?}");
        prop_assert!((one.fy_n + other.fy_n).abs() <= 1e-9 * size, "{one:?} {other:?}");
        prop_assert_eq!(one.contacts, [other.contacts[1], other.contacts[0]]);
    }

    /// Twice the size: forces scale with stiffness over length.
    #[test]
    fn results_scale_with_the_units(setup in setups(), position in 0.0..1.0_f64) {
        let Ok(model) = Model::new(&setup) else { return Ok(()) };
        let Some([first, last]) = model.extent_m() else { return Ok(()) };
        let mut large = setup;
        for length in [
            &mut large.ellipse.semi_length_m, &mut large.ellipse.semi_width_m,
            &mut large.beam.length_m, &mut large.channel.width_m, &mut large.channel.pitch_m,
            &mut large.pose.offset_m,
        ] {
            *length *= 2.0;
        }
        let x = first + (last - first) * position;
        let (small, large) = (model.total(x), Model::new(&large).unwrap().total(2.0 * x));
        // Powers of two do not round: k_t/L falls to a quarter.
        prop_assert_eq!(small.fx_n, 4.0 * large.fx_n);
        prop_assert_eq!(small.contacts, large.contacts);
    }

    #[test]
    fn no_position_on_the_plateau_has_a_greater_or_smaller_drag(
        semi_width in 0.045..0.06_f64, width in 0.04..0.085_f64, friction in 0.0..3.0_f64,
    ) {
        let mut setup = Setup::default();
        setup.ellipse.semi_width_m = semi_width;
        setup.channel = beam_channel::Channel { width_m: width, beams: 30, ..setup.channel };
        setup.beam.friction = friction;
        let Some(plateau) = Model::new(&setup).unwrap().plateau() else { return Ok(()) };
        let model = Model::new(&setup).unwrap();
        let pitch = setup.channel.pitch_m;
        let drag = |i: u32| -model.total(plateau.extent_m[0] + pitch * f64::from(i) / 4000.0).fx_n;
        let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
        for i in 1..4000 {
            least = least.min(drag(i));
            greatest = greatest.max(drag(i));
        }
        let slack = 1e-13 * greatest.abs();
        prop_assert!(plateau.peak.drag_n >= greatest - slack, "{plateau:?} {greatest}");
        prop_assert!(plateau.minimum.drag_n <= least + slack, "{plateau:?} {least}");
        // Near a jump the drag changes like a square root, of which samples 1/4000 of a spacing apart miss a few
        // percent.
        prop_assert!(plateau.peak.drag_n - greatest < 0.03 * greatest.abs(), "{plateau:?} {greatest}");
        prop_assert!(least - plateau.minimum.drag_n < 0.03 * greatest.abs(), "{plateau:?} {least}");
    }
}

proptest! {
    // Each case sums twenty thousand positions.
    #![proptest_config(ProptestConfig::with_cases(30))]

    #[test]
    fn work_is_the_integral_of_drag(width in 0.04..0.099_f64, friction in 0.0..2.0_f64) {
        let mut setup = Setup::default();
        setup.channel.width_m = width;
        setup.beam.friction = friction;
        let model = Model::new(&setup).unwrap();
        let [first, last] = model.extent_m().unwrap();
        let steps = 20_000;
        let step = (last - first) / f64::from(steps);
        let sum: f64 = (0..=steps).map(|i| -model.total(first + step * f64::from(i)).fx_n).sum();
        // The drag jumps 22 times by less than its maximum: an error of half a step each.
        let peak = model.plateau().unwrap().peak.drag_n;
        let tolerance = 11.0 * step * peak;
        prop_assert!((step * sum - model.energy()).abs() < tolerance);
        let work = model.work(first - 1.0, 0.11) + model.work(0.11, last + 1.0);
        // Two sums of about twenty integrals, each exact to rounding.
        prop_assert!((work / model.energy() - 1.0).abs() < 1e-13);
    }
}
