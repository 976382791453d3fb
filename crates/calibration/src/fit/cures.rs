//! Cures: changes of a reference that make it agree with a calibration. They exchange, turn or mirror
//! axes, or change signs, units, a zero or a delay.
//!
//! The errors after a signed permutation with a scale and a zero follow from products of predicted and
//! measured axes about their means. If `k` is the sign times the scale, the mean squared error is
//! `⟨(p − k·w)²⟩ = ⟨p²⟩ − 2k⟨pw⟩ + k²⟨w²⟩`, plus `(p̄ − k·w̄)²` unless a zero is subtracted. All 48
//! turns and mirrors of forces and of moments thus cost almost no time.

use least_squares::quality::significant;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Minimum factor by which a cure reduces the error of the worst axis.
const SMALLER: f64 = 3.0;

/// Largest squared error after a cure, as a share of the squared loads: a small scale makes the errors
/// of any reference small, even of noise.
const MOST_LEFT: f64 = 0.3;

/// Changes whose errors are within this factor of the smallest count as equally good.
const AS_GOOD: f64 = 1.15;

/// Factors from a recorded force to N, and from a recorded moment to N·m, with their descriptions.
const FORCE_SCALES: [(f64, &str); 8] = [
    (1e-3, "dividing forces by 1000 (mN)"),
    (1e3, "multiplying forces by 1000 (kN)"),
    (4.448_221_615_260_5, "converting forces from lbf"),
    (1.0 / 4.448_221_615_260_5, "converting forces to lbf"),
    (9.806_65, "converting forces from kgf"),
    (1.0 / 9.806_65, "converting forces to kgf"),
    (9.806_65e-3, "converting forces from gf"),
    (1.0 / 9.806_65e-3, "converting forces to gf"),
];
const MOMENT_SCALES: [(f64, &str); 10] = [
    (1e-3, "dividing moments by 1000 (N·mm)"),
    (1e3, "multiplying moments by 1000"),
    (1e-2, "dividing moments by 100 (N·cm)"),
    (1e2, "multiplying moments by 100"),
    (0.112_984_829_027_616_7, "converting moments from lbf·in"),
    (1.0 / 0.112_984_829_027_616_7, "converting moments to lbf·in"),
    (1.355_817_948_331_400_4, "converting moments from lbf·ft"),
    (1.0 / 1.355_817_948_331_400_4, "converting moments to lbf·ft"),
    (9.806_65, "converting moments from kgf·m"),
    (1.0 / 9.806_65, "converting moments to kgf·m"),
];

/// Longest delay that is tried, in rows.
const LONGEST_DELAY: usize = 64;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cure {
    /// The change, as in "exchanging Fx and Fy".
    pub(super) change: String,
    pub(super) axis: Axis,
    pub(super) rms: [f64; 2],
    pub(super) is_zero: bool,
}

impl Cure {
    fn new(
        change: String,
        axes: Axes,
        before: &PerAxis<f64>,
        after: &PerAxis<f64>,
    ) -> Option<Self> {
        let gain = |axis: &Axis| before[axis.index()] / after[axis.index()].max(f64::MIN_POSITIVE);
        let axis = axes.iter().max_by(|a, b| gain(a).total_cmp(&gain(b)))?;
        Some(Self {
            change,
            axis,
            rms: [before[axis.index()], after[axis.index()]],
            is_zero: false,
        })
    }

    /// Returns the change as a cure if errors fall enough, to a small share of the root mean square
    /// `loads`.
    pub(super) fn if_cured(
        change: String,
        axes: Axes,
        limit: &PerAxis<f64>,
        loads: &PerAxis<f64>,
        [before, after]: [&PerAxis<f64>; 2],
    ) -> Option<Self> {
        let worst = |errors| worst(errors, limit, axes);
        let explains = |block: [usize; 3]| {
            let square =
                |of: &PerAxis<f64>| block.map(|axis| of[axis] * of[axis]).iter().sum::<f64>();
            square(after) <= MOST_LEFT * square(loads)
        };
        let is_cured =
            cures(worst(before), worst(after)) && explains([0, 1, 2]) && explains([3, 4, 5]);
        is_cured.then(|| Self::new(change, axes, before, after)).flatten()
    }
}

fn worst(errors: &PerAxis<f64>, limit: &PerAxis<f64>, axes: Axes) -> f64 {
    let ratio = |axis: Axis| errors[axis.index()] / limit[axis.index()].max(f64::MIN_POSITIVE);
    axes.iter().map(ratio).fold(0.0, f64::max)
}

impl std::fmt::Display for Cure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [before, after] = self.rms.map(|rms| significant(rms, 2));
        let (axis, unit) = (self.axis.name(), self.axis.unit());
        write!(f, "{} brings {axis} from {before} to {after} {unit}", self.change)
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct WrenchProducts {
    rows: f64,
    means: [PerAxis<f64>; 2],
    predicted: PerAxis<f64>,
    measured: PerAxis<f64>,
    /// Products of a predicted axis (first index) and a measured one.
    both: PerAxis<PerAxis<f64>>,
}

/// Source of an axis: `sign · scale` times the axis `from` of the reference, minus any zero.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Reading {
    from: usize,
    sign: f64,
}

#[derive(Clone, Debug)]
struct BlockChange {
    axes: [Reading; 3],
    scale: (f64, &'static str),
    zero: bool,
}

impl WrenchProducts {
    pub(super) fn new(predicted: &PerAxis<Vec<f64>>, measured: &[Vec<f64>]) -> Self {
        let rows = predicted[0].len();
        let count = rows.max(1) as f64;
        let mean = |column: &[f64]| column.iter().sum::<f64>() / count;
        let [p, w]: [PerAxis<f64>; 2] = [
            std::array::from_fn(|axis| mean(&predicted[axis])),
            std::array::from_fn(|axis| mean(&measured[axis])),
        ];
        let about = |a: &[f64], of_a: f64, b: &[f64], of_b: f64| {
            a.iter().zip(b).map(|(x, y)| (x - of_a) * (y - of_b)).sum::<f64>() / count
        };
        Self {
            rows: rows as f64,
            means: [p, w],
            predicted: std::array::from_fn(|i| about(&predicted[i], p[i], &predicted[i], p[i])),
            measured: std::array::from_fn(|i| about(&measured[i], w[i], &measured[i], w[i])),
            both: std::array::from_fn(|i| {
                std::array::from_fn(|j| about(&predicted[i], p[i], &measured[j], w[j]))
            }),
        }
    }

    fn rms(&self, axis: usize, of: Reading, scale: f64, zero: bool) -> f64 {
        let k = of.sign * scale;
        let about_means = self.predicted[axis] - 2.0 * k * self.both[axis][of.from]
            + k * k * self.measured[of.from];
        let off = self.means[0][axis] - k * self.means[1][of.from];
        (about_means.max(0.0) + if zero { 0.0 } else { off * off }).sqrt()
    }

    pub(super) fn loads(&self) -> PerAxis<f64> {
        std::array::from_fn(|axis| (self.measured[axis] + self.means[1][axis].powi(2)).sqrt())
    }

    pub(super) fn plain(&self) -> PerAxis<f64> {
        std::array::from_fn(|axis| self.rms(axis, Reading { from: axis, sign: 1.0 }, 1.0, false))
    }

    fn of_block(&self, block: usize, change: &BlockChange) -> [f64; 3] {
        let BlockChange { axes, scale, zero } = change;
        std::array::from_fn(|at| self.rms(3 * block + at, axes[at], scale.0, *zero))
    }

    fn explains(&self, block: usize, change: &BlockChange) -> bool {
        let left: f64 = self.of_block(block, change).iter().map(|rms| rms * rms).sum();
        let load = |of: &Reading| {
            let zero = if change.zero { 0.0 } else { self.means[1][of.from] };
            change.scale.0.powi(2) * (self.measured[of.from] + zero * zero)
        };
        left <= MOST_LEFT * change.axes.iter().map(load).sum::<f64>()
    }

    pub(super) fn cure(&self, limit: &PerAxis<f64>, axes: Axes) -> Option<Cure> {
        if self.rows == 0.0 {
            return None;
        }
        let before = self.plain();
        let (mut after, mut changes) = (before, Vec::new());
        for block in 0..2 {
            let of = |axis: &Axis| axis.index() / 3 == block;
            let of_block: Axes = axes.iter().filter(of).collect();
            let changed = |change: &BlockChange| {
                let mut errors = before;
                errors[3 * block..3 * block + 3].copy_from_slice(&self.of_block(block, change));
                errors
            };
            let score = |change: &BlockChange| match self.explains(block, change) {
                true => worst(&changed(change), limit, of_block),
                false => f64::INFINITY,
            };
            if let Some(change) = simplest(block, worst(&before, limit, of_block), score) {
                after = std::array::from_fn(|axis| match axis / 3 == block {
                    true => changed(&change)[axis],
                    false => after[axis],
                });
                changes.push((block, change));
            }
        }
        if changes.is_empty() {
            return self.across(limit, axes);
        }
        let is_zero = changes.iter().any(|(_, change)| change.zero);
        Cure::new(words(&changes), axes, &before, &after).map(|cure| Cure { is_zero, ..cure })
    }

    /// Finds an exchange that cures the errors: of one force with one moment, or of all forces with all moments.
    fn across(&self, limit: &PerAxis<f64>, axes: Axes) -> Option<Cure> {
        let before = self.plain();
        let read = |order: [usize; 6]| -> PerAxis<f64> {
            std::array::from_fn(|axis| {
                self.rms(axis, Reading { from: order[axis], sign: 1.0 }, 1.0, false)
            })
        };
        let one = (0..3).flat_map(|force| (3..6).map(move |moment| (force, moment)));
        let pairs = one.map(|(force, moment)| {
            let mut order = [0, 1, 2, 3, 4, 5];
            order.swap(force, moment);
            let [a, b] = [force, moment].map(|axis| Axis::ALL[axis].name());
            (format!("exchanging {a} and {b}"), order)
        });
        let all = ("exchanging forces and moments".to_owned(), [3, 4, 5, 0, 1, 2]);
        let tried = std::iter::once(all).chain(pairs).map(|of| (read(of.1), of));
        let score = |errors: &PerAxis<f64>| worst(errors, limit, axes);
        let best = tried.min_by(|a, b| score(&a.0).total_cmp(&score(&b.0)));
        let (after, (change, order)) = best?;
        let loads = order.map(|from| self.loads()[from]);
        Cure::if_cured(change, axes, limit, &loads, [&before, &after])
    }
}

fn cures(before: f64, after: f64) -> bool {
    before > 1.0 && before > SMALLER * after
}

/// Finds a change that cures the block. One step (exchanged axes and signs, a unit, or a zero) is preferred to two.
fn simplest(block: usize, now: f64, score: impl Fn(&BlockChange) -> f64) -> Option<BlockChange> {
    let none = (1.0, "");
    let scales = if block == 0 { &FORCE_SCALES[..] } else { &MOMENT_SCALES[..] };
    let identity = signed_permutations(block).next()?;
    let turned =
        |scale, zero| signed_permutations(block).map(move |axes| BlockChange { axes, scale, zero });
    let unit = |axes, zero| scales.iter().map(move |&scale| BlockChange { axes, scale, zero });
    let mut single: Vec<BlockChange> = turned(none, false).skip(1).collect();
    single.extend(unit(identity, false));
    single.push(BlockChange { axes: identity, scale: none, zero: true });
    let mut double: Vec<BlockChange> = turned(none, true).skip(1).collect();
    double.extend(scales.iter().flat_map(|&scale| turned(scale, false)));
    double.extend(unit(identity, true));
    // Two changes improve any reference somewhat, so they must bring the errors within the limits.
    for (changes, most) in [(single, f64::INFINITY), (double, 1.0)] {
        let scored: Vec<(f64, BlockChange)> =
            changes.into_iter().map(|change| (score(&change), change)).collect();
        let best = scored.iter().map(|(score, _)| *score).fold(f64::INFINITY, f64::min);
        // Among equally good changes, the first is the simplest.
        let found = scored.into_iter().find(|(score, _)| *score <= AS_GOOD * best);
        if let Some((_, change)) = found.filter(|(after, _)| *after <= most && cures(now, *after)) {
            return Some(change);
        }
    }
    None
}

/// All 48 turns and mirrors of the axes of a block, in order of increasing change.
fn signed_permutations(block: usize) -> impl Iterator<Item = [Reading; 3]> {
    const ORDERS: [[usize; 3]; 6] =
        [[0, 1, 2], [1, 0, 2], [0, 2, 1], [2, 1, 0], [1, 2, 0], [2, 0, 1]];
    const SIGNS: [[f64; 3]; 8] = [
        [1.0, 1.0, 1.0],
        [-1.0, 1.0, 1.0],
        [1.0, -1.0, 1.0],
        [1.0, 1.0, -1.0],
        [-1.0, -1.0, -1.0],
        [-1.0, -1.0, 1.0],
        [-1.0, 1.0, -1.0],
        [1.0, -1.0, -1.0],
    ];
    ORDERS.into_iter().flat_map(move |order| {
        SIGNS.into_iter().map(move |signs| {
            std::array::from_fn(|at| Reading { from: 3 * block + order[at], sign: signs[at] })
        })
    })
}

fn words(changes: &[(usize, BlockChange)]) -> String {
    let rigid = |change: &BlockChange| change.axes.map(|axis| (axis.from % 3, axis.sign));
    if let [(_, forces), (_, moments)] = changes
        && forces.scale.0 == 1.0
        && moments.scale.0 == 1.0
        && !forces.zero
        && !moments.zero
    {
        let (forces, moments) = (rigid(forces), rigid(moments));
        // A mirror also changes the sign of moments: they are axial vectors.
        let handed = determinant(&forces);
        if moments == forces.map(|(from, sign)| (from, handed * sign)) {
            return format!("{} of forces and moments", frame(&forces));
        }
        if moments == forces {
            return format!("{} of forces and of moments alike", columns(["x", "y", "z"], &forces));
        }
    }
    let one = |(block, change): &(usize, BlockChange)| {
        let names = std::array::from_fn(|at| Axis::ALL[3 * block + at].name());
        let mut parts = Vec::new();
        let axes = rigid(change);
        if axes != rigid_identity() {
            parts.push(columns(names, &axes));
        }
        if change.scale.0 != 1.0 {
            parts.push(change.scale.1.to_owned());
        }
        if change.zero {
            let of = if *block == 0 { "forces" } else { "moments" };
            parts.push(format!("another zero of {of}"));
        }
        parts.join(", ")
    };
    changes.iter().map(one).collect::<Vec<_>>().join(" and ")
}

type Signed = [(usize, f64); 3];

fn rigid_identity() -> Signed {
    std::array::from_fn(|at| (at, 1.0))
}

fn determinant(axes: &Signed) -> f64 {
    let order = axes.map(|(from, _)| from);
    let inversions = [(0, 1), (0, 2), (1, 2)].iter().filter(|(a, b)| order[*a] > order[*b]).count();
    let parity = if inversions % 2 == 0 { 1.0 } else { -1.0 };
    axes.iter().map(|(_, sign)| sign).product::<f64>() * parity
}

fn frame(axes: &Signed) -> String {
    const NAMES: [&str; 3] = ["x", "y", "z"];
    let kept: Vec<usize> = (0..3).filter(|&at| axes[at] == (at, 1.0)).collect();
    let stays = (0..3).all(|at| axes[at].0 == at);
    let turned: Vec<&str> = (0..3).filter(|&at| axes[at].1 < 0.0).map(|at| NAMES[at]).collect();
    match (determinant(axes) > 0.0, &kept[..]) {
        (true, [about]) if stays => format!("a turn by 180° about {}", NAMES[*about]),
        (true, [about]) => format!("a turn by 90° about {}", NAMES[*about]),
        (true, _) => format!("a turn of the frame ({})", columns(NAMES, axes)),
        (false, _) if stays && turned.len() == 1 => {
            format!("mirroring {} (another handedness)", turned[0])
        }
        (false, _) if stays => "mirroring all axes (another handedness)".to_owned(),
        (false, _) => format!("a mirror ({})", columns(NAMES, axes)),
    }
}

fn columns(names: [&str; 3], axes: &Signed) -> String {
    let moved: Vec<usize> = (0..3).filter(|&at| axes[at].0 != at).collect();
    let turned: Vec<&str> = (0..3).filter(|&at| axes[at].1 < 0.0).map(|at| names[at]).collect();
    match (&moved[..], &turned[..]) {
        ([], [one]) => format!("turning the sign of {one}"),
        ([], [a, b]) => format!("turning the signs of {a} and {b}"),
        ([], _) => format!("turning the signs of {}", names.join(", ")),
        ([a, b], []) => format!("exchanging {} and {}", names[*a], names[*b]),
        _ => {
            let sign = |sign: f64| if sign < 0.0 { "−" } else { "" };
            let from = axes.map(|(from, of)| format!("{}{}", sign(of), names[from]));
            format!("taking {} from {}", names.join(", "), from.join(", "))
        }
    }
}

pub(super) fn delay(
    predicted: &PerAxis<Vec<f64>>,
    measured: &[Vec<f64>],
    limit: &PerAxis<f64>,
    axes: Axes,
) -> Option<(i64, Cure)> {
    let rows = predicted[0].len();
    let most = LONGEST_DELAY.min(rows / 4);
    let errors = |by: i64| -> PerAxis<f64> {
        let (from, to) = (most, rows - most);
        std::array::from_fn(|axis| {
            let square = |row: usize| {
                let then = (row as i64 + by) as usize;
                (predicted[axis][row] - measured[axis][then]).powi(2)
            };
            let squares: f64 = (from..to).map(square).sum();
            (squares / (to - from).max(1) as f64).sqrt()
        })
    };
    let score = |errors: &PerAxis<f64>| worst(errors, limit, axes);
    let before = errors(0);
    let most = most as i64;
    let tried = (-most..=most).map(|by| (by, errors(by)));
    let (by, after) = tried.min_by(|a, b| score(&a.1).total_cmp(&score(&b.1)))?;
    let rows = if by.abs() == 1 { "row" } else { "rows" };
    let which = if by > 0 { "earlier" } else { "later" };
    let change = format!("taking the reference {} {rows} {which}", by.abs());
    let loads = WrenchProducts::new(predicted, measured).loads();
    Cure::if_cured(change, axes, limit, &loads, [&before, &after]).map(|cure| (by, cure))
}

#[cfg(test)]
mod tests {
    use super::*;
    use system_tests::random::Random;

    /// Wandering loads of 400 rows, and predictions with errors of a hundredth of them.
    fn rows() -> (PerAxis<Vec<f64>>, Vec<Vec<f64>>) {
        let mut random = Random(7);
        let mut measured: Vec<Vec<f64>> = (0..6).map(|_| vec![0.0]).collect();
        for _ in 1..400 {
            for column in &mut measured {
                column.push(0.9 * column[column.len() - 1] + random.normal());
            }
        }
        let err = |column: &Vec<f64>| column.iter().map(|x| x + 0.02 * random.normal()).collect();
        let predicted: Vec<Vec<f64>> = measured.iter().map(err).collect();
        (predicted.try_into().unwrap(), measured)
    }

    const LIMIT: PerAxis<f64> = [0.05; 6];

    fn cure_of(spoil: impl Fn(&mut Vec<Vec<f64>>)) -> Option<String> {
        let (predicted, mut measured) = rows();
        spoil(&mut measured);
        let found = WrenchProducts::new(&predicted, &measured).cure(&LIMIT, Axes::ALL);
        found.map(|cure| cure.change)
    }

    fn negate(column: &mut [f64]) {
        column.iter_mut().for_each(|value| *value = -*value);
    }

    #[test]
    fn each_way_to_spoil_a_reference_is_named() {
        assert_eq!(cure_of(|_| ()), None);
        type Spoiling<'a> = &'a dyn Fn(&mut Vec<Vec<f64>>);
        let cases: [(Spoiling<'_>, &str); 10] = [
            (&|w| w.swap(0, 1), "exchanging Fx and Fy"),
            (&|w| negate(&mut w[2]), "turning the sign of Fz"),
            (&|w| w[..3].iter_mut().for_each(|of| negate(of)), "turning the signs of Fx, Fy, Fz"),
            (
                &|w| w[3..].iter_mut().flatten().for_each(|x| *x *= 1e3),
                "dividing moments by 1000 (N·mm)",
            ),
            (
                &|w| w[..3].iter_mut().flatten().for_each(|x| *x /= 4.448_221_6),
                "converting forces from lbf",
            ),
            (&|w| w[0].iter_mut().for_each(|x| *x += 7.0), "another zero of forces"),
            (&|w| w.swap(2, 5), "exchanging Fz and Mz"),
            (&|w| w.rotate_left(3), "exchanging forces and moments"),
            // A mirror of y keeps the sign of moments about y and changes the others.
            (
                &|w| [1, 3, 5].into_iter().for_each(|axis| negate(&mut w[axis])),
                "mirroring y (another handedness) of forces and moments",
            ),
            (
                &|w| {
                    w.swap(0, 1);
                    w.swap(3, 4);
                    negate(&mut w[0]);
                    negate(&mut w[3]);
                },
                "a turn by 90° about z of forces and moments",
            ),
        ];
        for (spoil, expected) in cases {
            assert_eq!(cure_of(spoil).as_deref(), Some(expected));
        }
    }

    #[test]
    fn a_reference_that_is_noise_has_no_cure_and_one_that_is_late_has_its_delay() {
        let noise = cure_of(|w| {
            let mut random = Random(8);
            w.iter_mut().flatten().for_each(|x| *x = random.normal());
        });
        assert_eq!(noise, None);
        let (predicted, mut measured) = rows();
        measured.iter_mut().for_each(|column| column.rotate_right(9));
        let (by, cure) = delay(&predicted, &measured, &LIMIT, Axes::ALL).unwrap();
        assert_eq!((by, cure.change.as_str()), (9, "taking the reference 9 rows earlier"));
    }
}
