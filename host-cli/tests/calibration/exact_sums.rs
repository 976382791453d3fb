//! Properties of the exact sums: the same bits in any order, certain rank, honest refusal.

use calibration::FitError;
use calibration::exact::{Accumulator, ExactError, ExactFit, ExactSums, MAX_ROWS, StoredSums};
use calibration::model::{Basis, Model};
use calibration::rank_loss::RankLoss;
use calibration::scaling::Scaling;
use calibration::solver::{self, FitProblem, Rows, Solution, SolverKind, Workers, exact_sums};
use proptest::prelude::*;
use shell_data::block::Block;
use shell_data::wrench::Axis;
use system_tests::random::Random;

type Columns = Vec<Vec<f64>>;

/// Readings of `bits` bits and a wrench of full-length numbers.
fn rows(seed: u64, rows: usize, channels: usize, bits: u32) -> (Columns, Columns) {
    let mut random = Random(seed);
    let readings: Columns =
        (0..channels).map(|_| (0..rows).map(|_| random.bits(bits) as f64).collect()).collect();
    let wrench = (0..6)
        .map(|axis| {
            let of = |row: usize, noise: f64| {
                let s = readings[axis % channels][row] / f64::from(1u32 << bits);
                (s - 0.4) * (1.0 + s) + 1e-3 * noise
            };
            (0..rows).map(|row| of(row, random.bits(52) as f64 / 2f64.powi(52))).collect()
        })
        .collect();
    (readings, wrench)
}

fn sum(basis: Basis, readings: &Columns, wrench: &Columns) -> Result<ExactSums, ExactError> {
    let mut sums = Accumulator::new(basis, readings.len());
    sums.absorb(readings, wrench)?;
    sums.finish()
}

fn pick(columns: &Columns, order: &[usize]) -> Columns {
    columns.iter().map(|column| order.iter().map(|&row| column[row]).collect()).collect()
}

fn solve(moments: &ExactSums, basis: Basis, intercept: bool) -> Result<ExactFit, FitError> {
    let channels = moments.channels();
    moments.solve(&Model { basis, intercept, channels, memory: 0 }, 0.0)
}

fn bits(fit: &ExactFit) -> Vec<[(u64, u64); 6]> {
    let of =
        |c: calibration::double_double::DoubleDouble| (c.to_f64().to_bits(), c.tail().to_bits());
    fit.coefficients.iter().map(|row| row.map(of)).collect()
}

fn loss(moments: &ExactSums, basis: Basis, intercept: bool) -> RankLoss {
    match solve(moments, basis, intercept) {
        Err(FitError::RankDeficient(loss)) => loss,
        other => panic!("{other:?}"),
    }
}

/// A mixed order of rows. `step` must not have a common divisor with their number.
fn mixed(rows: usize, step: usize) -> Vec<usize> {
    (0..rows).map(|i| i * step % rows).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn any_order_and_any_split_gives_the_same_bits(
        seed: u64,
        channels in 1usize..4,
        narrow in 4u32..12,
        wide in 4u32..17,
        cuts in prop::collection::vec(0usize..1201, 0..7),
        basis in prop::sample::select(&Basis::ALL[..]),
    ) {
        // The range of readings and wrench changes in the middle.
        let (mut readings, mut wrench) = rows(seed, 600, channels, narrow);
        let (more, other) = rows(seed ^ 1, 601, channels, wide);
        for (column, more) in readings.iter_mut().zip(more) {
            column.extend(more);
        }
        for (column, other) in wrench.iter_mut().zip(other) {
            column.extend(other.iter().map(|w| w * 1e-4));
        }
        let whole = sum(basis, &readings, &wrench).unwrap();

        let order = mixed(1201, 577);
        let (shuffled, with) = (pick(&readings, &order), pick(&wrench, &order));
        prop_assert_eq!(&sum(basis, &shuffled, &with).unwrap(), &whole);

        let mut cuts = cuts;
        cuts.extend([0, 1201]);
        cuts.sort_unstable();
        let parts: Vec<Accumulator> = cuts
            .windows(2)
            .map(|cut| {
                let part: Vec<usize> = order[cut[0]..cut[1]].to_vec();
                let mut sums = Accumulator::new(basis, channels);
                sums.absorb(&pick(&readings, &part), &pick(&wrench, &part)).unwrap();
                sums
            })
            .collect();
        let mut merged = ExactSums::new(basis, channels);
        for part in parts.iter().rev() {
            merged.merge(&part.clone().finish().unwrap()).unwrap();
        }
        prop_assert_eq!(&merged, &whole);
        let mut merged = Accumulator::new(basis, channels);
        for part in parts {
            merged.merge(part).unwrap();
        }
        prop_assert_eq!(&merged.finish().unwrap(), &whole);
    }
}

fn block(readings: &Columns, wrench: &Columns, rows: std::ops::Range<usize>) -> Block {
    let cut = |columns: &Columns| columns.iter().map(|c| c[rows.clone()].to_vec()).collect();
    Block { rows: rows.len(), readings: cut(readings), wrench: cut(wrench), ..Block::default() }
}

/// A partial fit for each block, merged in order.
fn solve_block_by_block(model: Model, blocks: &[Block]) -> Solution {
    let empty = Accumulator::new(model.basis, model.channels);
    let mut all = empty.clone();
    for block in blocks {
        all.merge(Rows::from(block).reduce(&empty).unwrap()).unwrap();
    }
    all.finish().unwrap().solve(&model, 0.0).unwrap().solution
}

fn solve_on_threads(model: Model, blocks: &[Block], threads: usize) -> Solution {
    let rows = Rows::from_blocks(blocks, Workers::new(threads));
    let moments = exact_sums(model, &rows).unwrap();
    moments.solve(&model, 0.0).unwrap().solution
}

#[test]
fn one_two_and_seven_threads_give_the_same_solution() {
    let (mut readings, wrench) = rows(3, 9000, 8, 12);
    // The range grows, so the first rows' scale does not suffice.
    for column in &mut readings {
        column[..3000].iter_mut().for_each(|s| *s = (*s / 16.0).floor());
        column[3000..6000].iter_mut().for_each(|s| *s = (*s / 4.0).floor());
    }
    for basis in [Basis::Cubic, Basis::Quadratic, Basis::Poly3] {
        let model = Model { basis, intercept: true, channels: 8, memory: 0 };
        let blocks_of = |rows: usize| -> Vec<Block> {
            let starts = (0..9000).step_by(rows);
            starts.map(|start| block(&readings, &wrench, start..(start + rows).min(9000))).collect()
        };
        let whole = solve_block_by_block(model, &blocks_of(9000));
        assert_eq!(solve_block_by_block(model, &blocks_of(333)), whole);
        for (threads, rows) in [(1, 1000), (2, 1000), (7, 333), (7, 100)] {
            let found = solve_on_threads(model, &blocks_of(rows), threads);
            assert_eq!(found, whole, "{threads} threads, {rows} rows at once");
        }
    }
}

#[test]
fn moments_survive_being_written_down() {
    let (readings, wrench) = rows(4, 300, 3, 16);
    let moments = sum(Basis::Poly3, &readings, &wrench).unwrap();
    let stored = StoredSums::from(moments.clone());
    assert_eq!(ExactSums::try_from(stored.clone()).unwrap(), moments);
    let spoil: [fn(&mut StoredSums); 4] = [
        |stored| stored.rows += 1,
        |stored| stored.basis = Basis::Cubic,
        |stored| stored.channels[0].unit.fives = 40,
        |stored| stored.channels[0].lowest = -99_999,
    ];
    for (case, spoil) in spoil.into_iter().enumerate() {
        let mut spoilt = stored.clone();
        spoil(&mut spoilt);
        assert!(ExactSums::try_from(spoilt).is_err(), "{case}");
    }
}

#[test]
fn a_billion_rows_of_the_largest_readings_do_not_overflow() {
    // Doubling all rows doubles all sums, which changes no coefficient.
    let (mut readings, wrench) = rows(5, 256, 2, 16);
    for (i, column) in readings.iter_mut().enumerate() {
        for (row, s) in column.iter_mut().enumerate() {
            *s = if row % (i + 3) == 0 { *s } else { 65535.0 - (row % 5) as f64 };
        }
    }
    let mut moments = sum(Basis::Poly3, &readings, &wrench).unwrap();
    let few = solve(&moments, Basis::Poly3, true).unwrap();
    while moments.rows() < MAX_ROWS {
        moments.merge(&moments.clone()).unwrap();
    }
    assert_eq!(moments.rows(), 1 << 30);
    let many = solve(&moments, Basis::Poly3, true).unwrap();
    assert_eq!(bits(&many), bits(&few));
    let before = moments.clone();
    assert_eq!(moments.merge(&before.clone()), Err(ExactError::TooManyRows));
    assert_eq!(moments, before);
}

#[test]
fn readings_with_fractions_are_the_same_integers_in_other_units() {
    let (integers, wrench) = rows(6, 500, 2, 12);
    let coarse =
        solve(&sum(Basis::Cubic, &integers, &wrench).unwrap(), Basis::Cubic, true).unwrap();
    let in_units = |per_count: f64| {
        let finer = integers[0].iter().map(|s| s / per_count).collect();
        let fine = sum(Basis::Cubic, &vec![finer, integers[1].clone()], &wrench).unwrap();
        solve(&fine, Basis::Cubic, true).unwrap()
    };
    // A power of two changes no bit but those of centre and scale.
    let sixteenths = in_units(16.0);
    assert_eq!(bits(&sixteenths), bits(&coarse));
    let scaling = |fit: &ExactFit| fit.solution.scaling.clone();
    let (of_coarse, of_fine) = (scaling(&coarse), scaling(&sixteenths));
    assert_eq!(of_fine.scale[0], of_coarse.scale[0] / 16.0);
    assert_eq!(of_fine.centre, [of_coarse.centre[0] / 16.0, of_coarse.centre[1]]);
    // In tenths, the scale stays a power of two: eight of them.
    let tenths = in_units(10.0);
    let of_fine = scaling(&tenths);
    assert_eq!(of_fine.scale[0], of_coarse.scale[0] / 8.0);
    assert_eq!(of_fine.centre, [of_coarse.centre[0] / 10.0, of_coarse.centre[1]]);
    let powers = [1, 2, 3, 0, 0, 0, 0];
    for ((fine, coarse), power) in tenths.coefficients.iter().zip(&coarse.coefficients).zip(powers)
    {
        for (fine, coarse) in fine.iter().zip(coarse) {
            // A tenth of the reading over an eighth of the scale is 0.8 of the feature. Allow two roundings.
            let expected = coarse.to_f64() / 0.8_f64.powi(power);
            assert!((fine.to_f64() / expected - 1.0).abs() < 1e-15);
        }
    }
}

#[test]
fn decimals_that_come_late_are_the_same_as_decimals_from_the_start() {
    let (mut readings, wrench) = rows(7, 700, 2, 9);
    readings[1][650] += 0.25;
    let late = sum(Basis::Quadratic, &readings, &wrench).unwrap();
    let order: Vec<usize> = (0..700).rev().collect();
    let early = sum(Basis::Quadratic, &pick(&readings, &order), &pick(&wrench, &order)).unwrap();
    assert_eq!(late, early);
}

#[test]
fn rows_that_cannot_be_summed_exactly_are_refused_with_the_reason() {
    let refused = |change: &dyn Fn(&mut Columns, &mut Columns)| {
        let (mut readings, mut wrench) = rows(8, 300, 2, 12);
        change(&mut readings, &mut wrench);
        sum(Basis::Linear, &readings, &wrench).unwrap_err()
    };
    let pi = std::f64::consts::PI;
    for bad in [pi, 65536.0, 1e300, f64::INFINITY] {
        let error = refused(&|readings, _| readings[1][7] = bad);
        assert_eq!(error, ExactError::NotAnInteger { channel: 1, value: bad });
    }
    assert!(matches!(refused(&|r, _| r[0][7] = f64::NAN), ExactError::NotAnInteger { .. }));
    let wide = |readings: &mut Columns, _: &mut Columns| {
        (readings[0][2], readings[0][290]) = (-1.0, 65535.0);
    };
    assert_eq!(refused(&wide), ExactError::TooWide { channel: 0 });
    for bad in [f64::NAN, f64::INFINITY] {
        let error = refused(&|_, wrench| wrench[4][299] = bad);
        assert_eq!(error, ExactError::NotFinite { axis: Axis::My });
    }
    let error = refused(&|_, wrench| wrench[2][100] = 1e-100);
    assert_eq!(error, ExactError::TooManyPlaces { axis: Axis::Fz });
}

#[test]
fn a_wrench_in_any_unit_gives_coefficients_in_that_unit() {
    let (readings, wrench) = rows(9, 400, 3, 12);
    let fit = |factor: f64| {
        let wrench = wrench.iter().map(|w| w.iter().map(|x| x * factor).collect()).collect();
        solve(&sum(Basis::Cubic, &readings, &wrench).unwrap(), Basis::Cubic, true).unwrap()
    };
    let one = fit(1.0);
    for exponent in [-700, -3, 900] {
        let factor = 2f64.powi(exponent);
        let other = fit(factor);
        for (row, other) in one.coefficients.iter().zip(&other.coefficients) {
            for (c, other) in row.iter().zip(other) {
                assert_eq!(other.to_f64(), c.to_f64() * factor);
            }
        }
    }
}

#[test]
fn a_constant_channel_is_named() {
    let (mut readings, wrench) = rows(10, 300, 3, 12);
    readings[1].fill(77.0);
    for basis in Basis::ALL {
        let loss = loss(&sum(basis, &readings, &wrench).unwrap(), basis, true);
        assert_eq!(loss.dependences.len(), 1);
        assert_eq!(loss.dependences[0].to_string(), "channel `s2` is constant (always `77`)");
    }
}

#[test]
fn a_channel_beside_its_neighbour_by_zero_or_one_is_named_where_it_matters() {
    let (mut readings, wrench) = rows(11, 300, 3, 12);
    readings[1] = readings[0].iter().enumerate().map(|(i, s)| s + (i * i % 3) as f64).collect();
    let moments = |basis| sum(basis, &readings, &wrench).unwrap();
    assert!(solve(&moments(Basis::Linear), Basis::Linear, true).is_ok());
    let loss = loss(&moments(Basis::Quadratic), Basis::Quadratic, true);
    assert_eq!((loss.rank, loss.features), (9, 10));
    assert_eq!(
        loss.to_string(),
        "only `9` of `10` features are independent: `s2 - s1` takes only the values 0 and 1"
    );
}

#[test]
fn proportional_channels_are_named_with_their_ratio() {
    let (mut readings, wrench) = rows(12, 300, 3, 12);
    for s in &mut readings[0] {
        *s *= 2.0;
    }
    readings[2] = readings[0].iter().map(|s| 1.5 * s + 4.0).collect();
    let loss = loss(&sum(Basis::Linear, &readings, &wrench).unwrap(), Basis::Linear, true);
    assert_eq!(
        loss.dependences[0].to_string(),
        "channels `s1` and `s3` move as one (s3 = 1.5·s1 + 4)"
    );
}

#[test]
fn a_channel_of_two_values_makes_its_square_dependent() {
    let (mut readings, wrench) = rows(13, 300, 2, 12);
    readings[0] = (0..300).map(|i| if i * i % 5 == 1 { 90.0 } else { 13.0 }).collect();
    let loss = loss(&sum(Basis::Cubic, &readings, &wrench).unwrap(), Basis::Cubic, true);
    assert_eq!(loss.rank, 5);
    assert_eq!(loss.dependences.len(), 1);
    assert_eq!(loss.dependences[0].to_string(), "`s1` takes only the values 13 and 90");
}

#[test]
fn too_few_rows_are_distinguished_from_dependent_features() {
    let (readings, wrench) = rows(14, 8, 4, 12);
    let error = solve(&sum(Basis::Cubic, &readings, &wrench).unwrap(), Basis::Cubic, true);
    assert_eq!(error.unwrap_err(), FitError::TooFewRows { rows: 8, coefficients: 13 });
}

#[test]
fn sums_for_a_large_basis_solve_the_smaller_ones_within_it() {
    let (readings, wrench) = rows(15, 400, 3, 12);
    let large = sum(Basis::Poly3, &readings, &wrench).unwrap();
    for basis in Basis::ALL {
        let own = sum(basis, &readings, &wrench).unwrap();
        for intercept in [true, false] {
            let (a, b) = (solve(&large, basis, intercept), solve(&own, basis, intercept));
            assert_eq!(bits(&a.unwrap()), bits(&b.unwrap()));
        }
    }
    let small = sum(Basis::Linear, &readings, &wrench).unwrap();
    assert!(matches!(solve(&small, Basis::Cubic, true), Err(FitError::OtherFeatures { .. })));
}

#[test]
fn a_ridge_equals_householder_qr_and_solves_rank_deficient_problems() {
    let (mut readings, wrench) = rows(16, 500, 8, 12);
    readings[3] = readings[2].clone();
    let rows = block(&readings, &wrench, 0..500);
    let model = Model { basis: Basis::Linear, intercept: true, channels: 8, memory: 0 };
    let scaling = Scaling::from_sample(&readings, true);
    let problem = FitProblem { model, scaling, ridge: 1e-3 };
    let moments = exact_sums(model, &(&rows).into()).unwrap();
    let exact = moments.solve(&model, 1e-3).unwrap().solution;
    let problem = FitProblem { scaling: exact.scaling.clone(), ..problem };
    let (tsqr, _) = solver::fit(SolverKind::Tsqr, problem, &(&rows).into()).unwrap();
    assert_eq!((exact.rank, tsqr.rank), (8, 8));
    // Householder QR of a matrix of condition 1/√λ = 30.
    let close = |a: &faer::Mat<f64>, b: &faer::Mat<f64>| {
        assert!((a - b).norm_max() < 1e-12 * a.norm_max(), "{a:?} {b:?}");
    };
    close(&exact.coefficients, &tsqr.coefficients);
    close(&exact.residual_products, &tsqr.residual_products);
    let inverse = |solution: &Solution| {
        let factor = &solution.factor;
        factor.as_ref() * factor.transpose()
    };
    close(&inverse(&exact), &inverse(&tsqr));
}
