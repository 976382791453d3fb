//! Clamped bending beams, compared with a physics engine, with shooting, and with their energy.

use beam_channel::{Model, Normal, Setup, SetupError, Wall};

fn setup(width_m: f64, friction: f64) -> Setup {
    let mut setup = Setup::default();
    setup.channel.width_m = width_m;
    setup.beam.friction = friction;
    setup.rules.normal = Normal::Elastica;
    setup
}

fn plates(width_m: f64, friction: f64) -> Setup {
    let mut setup = setup(width_m, friction);
    setup.rules.normal = Normal::Plate;
    setup
}

/// Drags by SciPy 1.17.1 (the elastica's equation, shot at the tip's position) and by MuJoCo 4.0.0
/// (chains of six hinges whose last link touches).
#[test]
fn mean_drag_of_clamped_beams_equals_that_of_shooting_and_of_a_physics_engine() {
    for (width_m, shooting_n, engine_n) in
        [(0.08, 0.276, 0.277), (0.06, 0.597, 0.614), (0.04, 1.219, 1.226)]
    {
        let plateau = Model::new(&setup(width_m, 0.53)).unwrap().plateau().unwrap();
        // The limits are half a unit of the last digit, and 3 % for the six links per beam.
        assert!((plateau.mean_drag_n - shooting_n).abs() < 5.1e-4, "{width_m}: {plateau:?}");
        assert!((plateau.mean_drag_n / engine_n - 1.0).abs() < 0.03, "{width_m}: {plateau:?}");
    }
}

/// Drags of plates with contact at the face: by shooting for the force and the length up to the contact, and from
/// chains of twelve hinges. At 1 cm only tips touch.
#[test]
fn mean_drag_of_plates_is_that_of_shooting_and_of_a_physics_engine() {
    for (width_m, shooting_n, engine_n) in [(0.08, 0.2763, 0.2725), (0.06, 0.8884, 0.869)] {
        let plateau = Model::new(&plates(width_m, 0.53)).unwrap().plateau().unwrap();
        // The quadrature over 300 positions is good to 1e-4.
        assert!((plateau.mean_drag_n / shooting_n - 1.0).abs() < 5e-4, "{width_m}: {plateau:?}");
        // Chains of 6 and 12 hinges give 0.813 and 0.869 N: their error falls with the square of the number of hinges,
        // which leads to 0.888 N.
        assert!((plateau.mean_drag_n / engine_n - 1.0).abs() < 0.03, "{width_m}: {plateau:?}");
    }
    // The body reaches 3 cm past the tips of plates of 2.7 cm.
    let jams = Model::new(&plates(0.04, 0.53)).map(drop);
    assert!(matches!(jams, Err(SetupError::Flattens { .. })), "{jams:?}");
}

#[test]
fn drag_of_plates_is_continuous_between_tip_and_face() {
    let model = Model::new(&plates(0.06, 0.53)).unwrap();
    let side = model.side(Wall::Left).unwrap();
    let drag = |travel_m: f64| -> f64 {
        model.beams(Wall::Left, travel_m - side.engagement_m).next().unwrap().2.fx_n
    };
    let steps = 2000;
    let place = |i: u32| side.travel_m() * (f64::from(i) + 0.5) / f64::from(steps);
    let largest = (0..steps).map(|i| drag(place(i)).abs()).fold(0.0, f64::max);
    for i in 1..steps - 20 {
        // The drag rises to its maximum over a tenth of the way or more: 0.5 % in a step.
        let step = (drag(place(i)) - drag(place(i - 1))).abs();
        assert!(step < 0.01 * largest, "{i}: {step} of {largest}");
    }
}

/// A beam that a frictionless body hardly touches is a cantilever: `P` moves its tip by `P·L³/3EI`.
#[test]
fn force_at_the_first_touch_equals_that_of_a_cantilever() {
    let setup = setup(0.06, 0.0);
    let model = Model::new(&setup).unwrap();
    let side = model.side(Wall::Left).unwrap();
    // 10⁻⁵ of the way; the next order of the curve is quadratic in the beam's turn.
    let x_m = -side.engagement_m + 1e-5 * side.travel_m();
    let (_, contact, force) = model.beams(Wall::Left, x_m).next().unwrap();
    let flexural = setup.beam.torsional_stiffness() * setup.beam.length_m;
    let across = 3.0 * flexural * contact.reach_m / setup.beam.length_m.powi(3);
    assert!((-force.fx_n / across - 1.0).abs() < 1e-3, "{force:?} {across}");
}

#[test]
fn energy_of_clamped_beams_is_the_sum_of_the_drag_over_the_way() {
    let rules = [Normal::Elastica, Normal::Plate];
    for (normal, offset_m, yaw_rad) in
        rules.into_iter().flat_map(|normal| [(normal, 0.0, 0.0), (normal, 0.004, 0.2)])
    {
        let mut setup = setup(0.06, 0.53);
        setup.rules.normal = normal;
        (setup.pose.offset_m, setup.pose.yaw_rad) = (offset_m, yaw_rad);
        let model = Model::new(&setup).unwrap();
        let [from, to] = model.extent_m().unwrap();
        let count = 4000;
        let step = (to - from) / f64::from(count);
        let drag = |i: u32| -model.total(from + (f64::from(i) + 0.5) * step).fx_n;
        let sum = (0..count).map(drag).sum::<f64>() * step;
        // Each of 22 beams slips off within a step: 0.1 N times half a step each, with random sign.
        assert!((sum / model.energy() - 1.0).abs() < 1e-4, "{sum} {}", model.energy());
    }
}

/// A body that moves forward leaves tips farther and farther behind.
#[test]
fn tips_of_clamped_beams_advance_without_gaps() {
    for friction in [0.0, 0.2, 0.53, 1.5] {
        let tips = [0.099, 0.08, 0.06, 0.04].map(|width_m| setup(width_m, friction));
        let faces = [0.099, 0.08, 0.07, 0.06].map(|width_m| plates(width_m, friction));
        for setup in tips.into_iter().chain(faces) {
            // High friction holds plates in a narrow channel.
            let Ok(model) = Model::new(&setup) else {
                assert!(friction > 1.0 && setup.rules.normal == Normal::Plate, "{setup:?}");
                continue;
            };
            let width_m = setup.channel.width_m;
            let side = model.side(Wall::Left).unwrap();
            let place = |i: u32| {
                let contact = side.contact_after(side.travel_m() * f64::from(i) / 500.0).unwrap();
                side.place_rad(&contact)
            };
            for i in 0..500 {
                assert!(place(i) < place(i + 1), "{friction} {width_m} {i}");
            }
        }
    }
}

#[test]
fn friction_that_holds_clamped_tips_jams_the_body() {
    let mut narrow = setup(0.02, 6.0);
    narrow.beam.length_m = 0.021;
    assert!(
        matches!(Model::new(&narrow), Err(SetupError::Locks { .. })),
        "{:?}",
        Model::new(&narrow).map(|_| ())
    );
}
