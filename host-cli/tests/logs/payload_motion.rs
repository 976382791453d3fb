//! Payloads with unusual meanings of columns, and payloads that turn.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use forces::payload::rotation::{from_roll_pitch_yaw, transposed};
use forces::payload::{Matrix, Vector, times};
use system_tests::program::{ended, json, refused, succeed};
use system_tests::random::Random;

const MASS_KG: f64 = 0.5;
const CENTRE_M: Vector = [0.02, -0.03, 0.06];
const GRAVITY: Vector = [0.0, 0.0, -9.806_65];

fn join(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the wrench that a force on the body causes, plus the sensor's zero.
fn wrench(force: Vector) -> [f64; 6] {
    let [mx, my, mz] = cross(CENTRE_M, force);
    let [x, y, z] = force;
    [x + 0.3, y - 0.2, z + 0.1, mx + 0.01, my, mz - 0.02]
}

fn poses() -> Vec<(Vector, Matrix)> {
    let angles = |i: u32| [0.9, 0.7, 0.5].map(|k| (k * f64::from(i + 1)).sin() * 2.0);
    (0..16).map(|i| (angles(i), from_roll_pitch_yaw(angles(i)))).collect()
}

/// Writes poses with noise of 1 mN, and columns made of angles and rotation.
fn write_poses(
    path: &Path,
    columns: &str,
    exchange: impl Fn([f64; 6], &Matrix) -> [f64; 6],
    of: impl Fn(Vector, &Matrix) -> Vec<f64>,
) {
    let mut random = Random(5);
    let mut text = format!("fx,fy,fz,mx,my,mz,{columns}\n");
    for (angles, rotation) in poses() {
        let force = times(&transposed(&rotation), GRAVITY).map(|g| MASS_KG * g);
        let wrench = exchange(wrench(force), &rotation).map(|value| value + 1e-3 * random.normal());
        writeln!(text, "{},{}", join(&wrench), join(&of(angles, &rotation))).unwrap();
    }
    fs::write(path, text).unwrap();
}

fn as_it_is(wrench: [f64; 6], _: &Matrix) -> [f64; 6] {
    wrench
}

/// Shepperd's formula, scalar last, for scalars not near zero.
fn quaternion(m: &Matrix) -> [f64; 4] {
    let w = 0.5 * (1.0 + m[0][0] + m[1][1] + m[2][2]).max(1e-12).sqrt();
    let part = |a: f64| a / (4.0 * w);
    [part(m[2][1] - m[1][2]), part(m[0][2] - m[2][0]), part(m[1][0] - m[0][1]), w]
}

#[test]
fn orientations_that_are_written_otherwise_are_read_or_named() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let mass = |command: &str| {
        let found = json(dir, &format!("payload fit {command} --json"));
        found["mass_kg"].as_f64().unwrap()
    };
    // The tolerance is three standard errors of the mass: 1 mN, over some 30 forces of 5 N.
    let is_right = |mass: f64| (mass - MASS_KG).abs() < 1e-4;
    write_poses(&dir.join("right.csv"), "qx,qy,qz,qw", as_it_is, |_, m| quaternion(m).to_vec());
    assert!(is_right(mass("right.csv")));
    write_poses(&dir.join("inverse.csv"), "qx,qy,qz,qw", as_it_is, |_, m| {
        quaternion(&transposed(m)).to_vec()
    });
    let said = refused(dir, "payload fit inverse.csv");
    assert!(said.contains("the inverse rotation leaves 0.00"), "{said}");
    assert!(said.contains("`--inverse-orientation`"), "{said}");
    assert!(is_right(mass("inverse.csv --inverse-orientation")));
    write_poses(&dir.join("first.csv"), "a,b,c,d", as_it_is, |_, m| {
        let [x, y, z, w] = quaternion(m);
        vec![w, x, y, z]
    });
    let said = refused(dir, "payload fit first.csv --orientation a,b,c,d");
    assert!(said.contains("`--orientation-as`"), "{said}");
    assert!(is_right(mass("first.csv --orientation a,b,c,d --orientation-as quaternion-wxyz")));
    write_poses(&dir.join("vectors.csv"), "rx,ry,rz", as_it_is, |_, m| {
        let [x, y, z, w] = quaternion(m);
        let (sine, angle) = ((1.0 - w * w).sqrt(), 2.0 * w.acos());
        vec![x / sine * angle, y / sine * angle, z / sine * angle]
    });
    assert!(is_right(mass("vectors.csv")));
    assert!(is_right(mass("vectors.csv --orientation rx,ry,rz")));
    write_poses(&dir.join("degrees.csv"), "roll,pitch,yaw", as_it_is, |angles, _| {
        angles.map(f64::to_degrees).to_vec()
    });
    assert!(is_right(mass("degrees.csv")));
    write_poses(&dir.join("radians.csv"), "roll,pitch,yaw", as_it_is, |angles, _| angles.to_vec());
    let said = refused(dir, "payload fit radians.csv");
    assert!(said.contains("no unit in their names"), "{said}");
    assert!(is_right(mass("radians.csv --orientation-as rpy-rad")));
    write_poses(&dir.join("named.csv"), "roll_rad,pitch_rad,yaw_rad", as_it_is, |angles, _| {
        angles.to_vec()
    });
    assert!(is_right(mass("named.csv")));
    // These columns do not have the meaning that their number suggests.
    let said =
        refused(dir, "payload fit vectors.csv --orientation rx,ry,rz --orientation-as gravity");
    assert!(said.contains("gravity is") && said.contains("`--orientation-as`"), "{said}");
}

#[test]
fn accelerations_of_either_sign_are_read_and_moments_that_do_not_follow_named() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let gravity = |m: &Matrix| times(&transposed(m), GRAVITY);
    for (name, sign) in [("usual.csv", -1.0), ("reaction.csv", 1.0)] {
        write_poses(&dir.join(name), "ax,ay,az", as_it_is, |_, m| {
            gravity(m).map(|g| sign * g).to_vec()
        });
        let (out, said) = ended(dir, &format!("payload fit {name} --json"), 0);
        let found: serde_json::Value = serde_json::from_str(&out).unwrap();
        assert!((found["mass_kg"].as_f64().unwrap() - MASS_KG).abs() < 1e-4, "{found}");
        assert_eq!(said.contains("taken with the other sign"), sign > 0.0, "{said}");
    }
    let swapped = |[a, b, c, mx, my, mz]: [f64; 6], _: &Matrix| [a, b, c, mx, mz, my];
    write_poses(&dir.join("swapped.csv"), "gx,gy,gz", swapped, |_, m| gravity(m).to_vec());
    let (_, said) = ended(dir, "payload fit swapped.csv", 0);
    assert!(said.contains("exchanging My and Mz leaves 0.00"), "{said}");
    let upright = |[a, b, c, mx, my, mz]: [f64; 6], m: &Matrix| {
        let [x, y, z] = times(m, [mx, my, mz]);
        [a, b, c, x, y, z]
    };
    write_poses(&dir.join("upright.csv"), "qx,qy,qz,qw", upright, |_, m| quaternion(m).to_vec());
    let (_, said) = ended(dir, "payload fit upright.csv", 0);
    assert!(said.contains("turned from the upright frame"), "{said}");
    write_poses(&dir.join("right.csv"), "gx,gy,gz", as_it_is, |_, m| gravity(m).to_vec());
    let (_, said) = ended(dir, "payload fit right.csv", 0);
    assert!(!said.contains("do not follow"), "{said}");
}

/// Position, m, and attitude of an arm, which turns by 5 rad/s and swings.
fn arm(t: f64) -> (Vector, Matrix) {
    let at = [0.3 * (2.0 * t).sin(), 0.2 * (3.0 * t).cos(), 0.1 * (2.5 * t).sin()];
    (at, from_roll_pitch_yaw([0.8 * (3.1 * t).sin(), 0.6 * (2.3 * t).cos(), 5.0 * t]))
}

/// Position of a point fixed to the sensor, m.
fn place(t: f64, point: Vector) -> Vector {
    let (at, rotation) = arm(t);
    let turned = times(&rotation, point);
    std::array::from_fn(|i| at[i] + turned[i])
}

/// Acceleration of a point fixed to the sensor, minus gravity, by second differences, whose error is 1e-6 m/s².
fn felt(t: f64, point: Vector) -> Vector {
    const STEP_S: f64 = 1e-4;
    let [before, now, after] = [-STEP_S, 0.0, STEP_S].map(|step| place(t + step, point));
    let less: Vector = std::array::from_fn(|i| {
        (before[i] - 2.0 * now[i] + after[i]) / (STEP_S * STEP_S) - GRAVITY[i]
    });
    times(&transposed(&arm(t).1), less)
}

/// Angular velocity in the sensor's frame by first differences of its attitude.
fn rates(t: f64) -> Vector {
    const STEP_S: f64 = 1e-5;
    let [before, after] = [-STEP_S, STEP_S].map(|step| arm(t + step).1);
    let inverse = transposed(&arm(t).1);
    let element = |i: usize, j: usize| -> f64 {
        (0..3).map(|k| inverse[i][k] * (after[k][j] - before[k][j]) / (2.0 * STEP_S)).sum()
    };
    [element(2, 1), element(0, 2), element(1, 0)]
}

#[test]
fn inertia_of_rotation_is_removed_or_reported() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    write_poses(&dir.join("poses.csv"), "ax,ay,az", as_it_is, |_, m| {
        times(&transposed(m), GRAVITY).map(|g| -g).to_vec()
    });
    succeed(dir, "payload fit poses.csv -o payload.json");
    let mut random = Random(8);
    let run = |name: &str, columns: &str, of: &dyn Fn(f64) -> Vec<f64>, random: &mut Random| {
        let mut text = format!("t_s,fx,fy,fz,mx,my,mz,{columns}\n");
        for row in 0..600 {
            let t = 0.01 * f64::from(row);
            let force = felt(t, CENTRE_M).map(|a| -MASS_KG * a);
            let wrench = wrench(force).map(|value| value + 1e-3 * random.normal());
            writeln!(text, "{t},{},{}", join(&wrench), join(&of(t))).unwrap();
        }
        fs::write(dir.join(name), text).unwrap();
    };
    let acceleration = |t: f64| felt(t, [0.0; 3]).to_vec();
    run("alone.csv", "ax,ay,az", &acceleration, &mut random);
    run(
        "gyroscope.csv",
        "ax,ay,az,gyro_x,gyro_y,gyro_z",
        &|t| [acceleration(t), rates(t).to_vec()].concat(),
        &mut random,
    );
    run(
        "degrees.csv",
        "ax,ay,az,gyro_x (deg/s),gyro_y (deg/s),gyro_z (deg/s)",
        &|t| [acceleration(t), rates(t).map(f64::to_degrees).to_vec()].concat(),
        &mut random,
    );
    run(
        "rotations.csv",
        "ax,ay,az,r11,r12,r13,r21,r22,r23,r31,r32,r33",
        &|t| [acceleration(t), arm(t).1.concat()].concat(),
        &mut random,
    );
    run(
        "in_g.csv",
        "ax,ay,az,gyro_x,gyro_y,gyro_z",
        &|t| {
            let in_g = acceleration(t).into_iter().map(|a| a / 9.806_65).collect();
            [in_g, rates(t).to_vec()].concat()
        },
        &mut random,
    );
    let left = |name: &str| {
        let command =
            format!("payload subtract payload.json {name} --no-lowpass -o out.csv --json");
        let (out, said) = ended(dir, &command, 0);
        let summary: serde_json::Value = serde_json::from_str(&out).unwrap();
        let of = |axis| summary["load"]["standard_deviation"][axis].as_f64().unwrap();
        (["fx_n", "fy_n", "fz_n"].map(of).into_iter().fold(0.0, f64::max), said)
    };
    let (alone, said) = left("alone.csv");
    assert!(alone > 0.1, "{alone}");
    assert!(said.contains("inertia of rotation") && said.contains("N at 1 rad/s"), "{said}");
    // The noise is 1 mN; linear interpolation of rotations at 100 Hz adds 2 mN.
    for (name, most) in [("gyroscope.csv", 0.005), ("degrees.csv", 0.005), ("rotations.csv", 0.005)]
    {
        let (left, said) = left(name);
        println!("{name}: {left:.4} N left of turning, {alone:.3} N without");
        assert!(left < most, "{name}: {left}");
        assert!(!said.contains("inertia of rotation"), "{said}");
    }
    let (left, said) = left("in_g.csv");
    assert!(left < 0.005, "{left}");
    assert!(said.contains("in multiples of g") && said.contains("9.80665"), "{said}");
}

/// An arm of three joints in Pinocchio 4.1.0, which turns at 5 rad/s (`pinocchio/turning_arm.py`).
#[test]
fn a_payload_on_a_turning_arm_of_pinocchio_leaves_little_more_than_noise() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/logs/pinocchio");
    let cut = |from: &str, to: &str, ranges: &[std::ops::Range<usize>]| {
        let text = fs::read_to_string(source.join(from)).unwrap();
        let line = |line: &str| {
            let cells: Vec<&str> = line.split(',').collect();
            ranges
                .iter()
                .flat_map(|range| &cells[range.clone()])
                .copied()
                .collect::<Vec<_>>()
                .join(",")
        };
        fs::write(dir.join(to), text.lines().map(line).collect::<Vec<_>>().join("\n")).unwrap();
    };
    cut("poses.csv", "poses.csv", std::slice::from_ref(&(0..10)));
    let found = json(dir, "payload fit poses.csv -o payload.json --json");
    // Four standard errors of 24 poses with noise of 1 mN.
    assert!((found["mass_kg"].as_f64().unwrap() - 0.5).abs() < 1e-4, "{found}");
    // The noise is 1 mN. Orientations at 100 Hz add the error of the angular acceleration, from differences.
    for (name, ranges, most_n) in
        [("gyroscope.csv", [0..10, 10..13], 0.005), ("orientations.csv", [0..10, 13..17], 0.05)]
    {
        cut("turning.csv", name, &ranges);
        succeed(dir, &format!("payload subtract payload.json {name} --no-lowpass -o out.csv"));
        let out = fs::read_to_string(dir.join("out.csv")).unwrap();
        let force = |line: &str| -> Vec<f64> {
            line.split(',').skip(1).take(3).map(|cell| cell.parse().unwrap()).collect()
        };
        let forces: Vec<f64> = out.lines().skip(1).flat_map(force).collect();
        assert_eq!(forces.len(), 3 * 150, "{name}");
        let square = forces.iter().map(|force| force * force).sum::<f64>();
        let rms_n = (square / forces.len() as f64).sqrt();
        println!("{name}: {rms_n:.4} N");
        assert!(rms_n <= most_n, "{name}: {rms_n}");
    }
}
