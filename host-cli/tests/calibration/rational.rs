//! Least squares in exact rational arithmetic, by Dixon's p-adic lifting (Numer. Math. 40, 1982).
//! The result is checked: numerators and denominator satisfy the normal equations in whole numbers.

use calibration::model::Model;
use num_bigint::{BigInt, Sign};
use num_rational::BigRational;
use num_traits::{One, Signed, ToPrimitive, Zero};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

#[derive(Clone)]
pub(crate) struct Rows {
    pub(crate) readings: Vec<Vec<f64>>,
    pub(crate) wrench: Vec<Vec<f64>>,
}

impl Rows {
    pub(crate) fn recorded(name: &str) -> Self {
        let path = system_tests::real_recording(name);
        let text = std::fs::read_to_string(path).unwrap();
        let mut columns = vec![Vec::new(); 15];
        for line in text.lines() {
            for (column, field) in columns.iter_mut().zip(line.split(',')) {
                column.push(field.parse::<f64>().unwrap());
            }
        }
        Self { readings: columns[1..9].to_vec(), wrench: columns[9..15].to_vec() }
    }

    /// Correlated readings over a share `spread` of `bits` bits, and a noisy cubic wrench of them.
    pub(crate) fn synthetic(
        seed: u64,
        rows: usize,
        channels: usize,
        bits: u32,
        spread: f64,
    ) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut uniform = || random.next_u64() as f64 / 2f64.powi(64) - 0.5;
        let range = f64::from((1u32 << bits) - 1);
        let mut readings = vec![Vec::new(); channels];
        let mut wrench = vec![Vec::new(); 6];
        for _ in 0..rows {
            let load: [f64; 6] = std::array::from_fn(|_| uniform());
            for (i, column) in readings.iter_mut().enumerate() {
                let own = 0.6 * load[i % 6] + 0.2 * load[(i + 1) % 6] + 0.2 * uniform();
                let middle = 0.5 + (1.0 - spread) * (0.3 - 0.05 * i as f64);
                column.push(((middle + own * spread) * range).round().clamp(0.0, range));
            }
            for (axis, column) in wrench.iter_mut().enumerate() {
                column.push(load[axis] * (1.0 + 0.3 * load[axis]) * 5.0 + 0.1 * uniform());
            }
        }
        Self { readings, wrench }
    }

    pub(crate) fn len(&self) -> usize {
        self.wrench[0].len()
    }
}

/// `C = numerators / denominator · 2^exponent`, feature by feature; and its sums.
pub(crate) struct Solution {
    numerators: Vec<[BigInt; 6]>,
    denominator: BigInt,
    unit: i32,
    scale: Vec<BigRational>,
    right: Vec<[BigInt; 6]>,
    squares: [[BigInt; 6]; 6],
    sums: [BigInt; 6],
    rows: usize,
}

/// Solves for exact features of `(s − centre) / scale`; readings must be whole.
pub(crate) fn solve(rows: &Rows, model: &Model, centre: &[f64], scale: &[f64]) -> Solution {
    let terms = model.terms();
    let features: Vec<Vec<i128>> = (0..rows.len())
        .map(|row| {
            let value = |&c: &u8| {
                let c = usize::from(c);
                (rows.readings[c][row] - centre[c]) as i128
            };
            terms.iter().map(|term| term.factors().iter().map(value).product()).collect()
        })
        .collect();
    let nonzero = rows.wrench.iter().flatten().filter(|w| **w != 0.0);
    let unit = nonzero.map(|w| dyadic(*w).1).min().unwrap_or(0);
    let wrench: Vec<[BigInt; 6]> = (0..rows.len())
        .map(|row| std::array::from_fn(|axis| in_units(rows.wrench[axis][row], unit)))
        .collect();
    let size = terms.len();
    let mut gram = vec![vec![0i128; size]; size];
    let mut right: Vec<[BigInt; 6]> = vec![std::array::from_fn(|_| BigInt::zero()); size];
    for (x, w) in features.iter().zip(&wrench) {
        for a in 0..size {
            for b in 0..=a {
                gram[a][b] += x[a] * x[b];
            }
            for axis in 0..6 {
                right[a][axis] += &w[axis] * x[a];
            }
        }
    }
    let lower = gram.clone();
    for (a, row) in gram.iter_mut().enumerate() {
        row[a + 1..].iter_mut().zip(&lower[a + 1..]).for_each(|(x, below)| *x = below[a]);
    }
    let (numerators, denominator) = lift(&gram, &right);
    for (row, right) in gram.iter().zip(&right) {
        for axis in 0..6 {
            let left: BigInt = row.iter().zip(&numerators).map(|(g, n)| &n[axis] * *g).sum();
            assert_eq!(left, &right[axis] * &denominator, "the normal equations");
        }
    }
    let scale = terms
        .iter()
        .map(|term| {
            let of = |&c: &u8| BigRational::from_float(scale[usize::from(c)]).unwrap();
            term.factors().iter().map(of).product()
        })
        .collect();
    let sum = |f: &dyn Fn(&[BigInt; 6]) -> BigInt| wrench.iter().map(f).sum::<BigInt>();
    Solution {
        numerators,
        denominator,
        unit,
        scale,
        right,
        squares: std::array::from_fn(|a| std::array::from_fn(|b| sum(&|w| &w[a] * &w[b]))),
        sums: std::array::from_fn(|a| sum(&|w| w[a].clone())),
        rows: rows.len(),
    }
}

impl Solution {
    pub(crate) fn coefficients(&self) -> Vec<[BigRational; 6]> {
        let unit = power(self.unit);
        self.numerators
            .iter()
            .zip(&self.scale)
            .map(|(row, scale)| {
                std::array::from_fn(|axis| {
                    BigRational::new(row[axis].clone(), self.denominator.clone()) * &unit * scale
                })
            })
            .collect()
    }

    /// Returns products of residuals, and each axis's sum of squared differences from the mean.
    pub(crate) fn residuals(&self) -> ([[f64; 6]; 6], [f64; 6]) {
        let unit = power(2 * self.unit);
        let residuals = std::array::from_fn(|a| {
            std::array::from_fn(|b| {
                let explained: BigInt =
                    self.numerators.iter().zip(&self.right).map(|(n, r)| &n[a] * &r[b]).sum();
                let rest = &self.squares[a][b] * &self.denominator - explained;
                (BigRational::new(rest, self.denominator.clone()) * &unit).to_f64().unwrap()
            })
        });
        let total = std::array::from_fn(|a| {
            let rest = &self.squares[a][a] * self.rows - &self.sums[a] * &self.sums[a];
            (BigRational::new(rest, self.rows.into()) * &unit).to_f64().unwrap()
        });
        (residuals, total)
    }
}

/// `|computed − exact| / |exact|` of each coefficient.
pub(crate) fn relative_errors(computed: &[[f64; 6]], exact: &Solution) -> Vec<[f64; 6]> {
    let relative = |computed: f64, exact: &BigRational| {
        let difference = (BigRational::from_float(computed).unwrap() - exact).abs();
        match exact.is_zero() {
            true if difference.is_zero() => 0.0,
            true => f64::INFINITY,
            false => (difference / exact.abs()).to_f64().unwrap(),
        }
    };
    let exact = exact.coefficients();
    assert_eq!(computed.len(), exact.len());
    let rows = computed.iter().zip(&exact);
    rows.map(|(c, e)| std::array::from_fn(|axis| relative(c[axis], &e[axis]))).collect()
}

fn power(exponent: i32) -> BigRational {
    let power = BigInt::one() << exponent.unsigned_abs();
    if exponent < 0 { BigRational::new(BigInt::one(), power) } else { power.into() }
}

fn dyadic(value: f64) -> (BigInt, i32) {
    let exact = BigRational::from_float(value).unwrap();
    let down = exact.denom().trailing_zeros().unwrap_or(0) as i32;
    (exact.numer().clone(), -down)
}

fn in_units(value: f64, unit: i32) -> BigInt {
    let (mantissa, exponent) = dyadic(value);
    mantissa << (exponent - unit)
}

/// The largest prime below 2⁶¹ − 1.
const PRIME: u64 = (1 << 61) - 31;

fn times(a: u64, b: u64) -> u64 {
    (u128::from(a) * u128::from(b) % u128::from(PRIME)) as u64
}

fn inverse(a: u64) -> u64 {
    let (mut base, mut exponent, mut result) = (a, PRIME - 2, 1);
    while exponent > 0 {
        if exponent % 2 == 1 {
            result = times(result, base);
        }
        base = times(base, base);
        exponent /= 2;
    }
    result
}

/// Numerators and the common denominator of `A⁻¹·B`.
fn lift(a: &[Vec<i128>], b: &[[BigInt; 6]]) -> (Vec<[BigInt; 6]>, BigInt) {
    let size = a.len();
    let prime = BigInt::from(PRIME);
    let inverse = inverse_matrix(a);
    // Numerators and denominators are minors: at most the product of the columns' norms.
    let bits = |row: &Vec<i128>| {
        // The norm is at most √p < 2⁴ times the largest element.
        let largest = row.iter().map(|x| x.unsigned_abs()).max().unwrap_or(0);
        128 - largest.leading_zeros() + 4
    };
    let gram_bits: u64 = a.iter().map(|row| u64::from(bits(row))).sum();
    let right_bits = b.iter().flatten().map(BigInt::bits).max().unwrap_or(0) + 8;
    let steps = (2 * gram_bits + right_bits + 2).div_ceil(60);
    let mut residues: Vec<[BigInt; 6]> = vec![std::array::from_fn(|_| BigInt::zero()); size];
    let mut modulus = BigInt::one();
    let mut rest: Vec<[BigInt; 6]> = b.to_vec();
    for _ in 0..steps {
        let reduced: Vec<[u64; 6]> = rest
            .iter()
            .map(|row| std::array::from_fn(|axis| residue(&row[axis], &prime)))
            .collect();
        let digits: Vec<[u64; 6]> = (0..size)
            .map(|i| {
                std::array::from_fn(|axis| {
                    let products = inverse[i].iter().zip(&reduced);
                    products.fold(0, |sum, (&x, r)| (sum + times(x, r[axis])) % PRIME)
                })
            })
            .collect();
        for i in 0..size {
            for axis in 0..6 {
                // Sums of products of 61 bits with both halves of the matrix elements.
                let (mut high, mut low) = (0i128, 0i128);
                for (x, digit) in a[i].iter().zip(&digits) {
                    let digit = i128::from(digit[axis]);
                    high += (x >> 50) * digit;
                    low += (x & ((1 << 50) - 1)) * digit;
                }
                let sum = (BigInt::from(high) << 50) + low;
                rest[i][axis] = (&rest[i][axis] - sum) / &prime;
                residues[i][axis] += &modulus * digits[i][axis];
            }
        }
        modulus *= &prime;
    }
    let mut denominator = BigInt::one();
    let mut numerators: Vec<[BigInt; 6]> = vec![std::array::from_fn(|_| BigInt::zero()); size];
    let bound = BigInt::one() << (gram_bits + right_bits);
    loop {
        let mut complete = true;
        for (numerators, residues) in numerators.iter_mut().zip(&residues) {
            for axis in 0..6 {
                let value = balanced(&residues[axis] * &denominator, &modulus);
                if value.abs() > bound {
                    denominator *= denominator_of(&value, &modulus, &bound);
                    complete = false;
                }
                numerators[axis] = value;
            }
        }
        if complete {
            return (numerators, denominator);
        }
    }
}

fn residue(value: &BigInt, prime: &BigInt) -> u64 {
    let rest = value % prime;
    let rest = if rest.sign() == Sign::Minus { rest + prime } else { rest };
    rest.to_u64().unwrap()
}

fn balanced(value: BigInt, modulus: &BigInt) -> BigInt {
    let rest = ((value % modulus) + modulus) % modulus;
    if &rest * 2 > *modulus { rest - modulus } else { rest }
}

fn denominator_of(value: &BigInt, modulus: &BigInt, bound: &BigInt) -> BigInt {
    let (mut r, mut next) = (modulus.clone(), balanced(value.clone(), modulus));
    if next.is_negative() {
        next = -next;
    }
    let (mut t, mut next_t) = (BigInt::zero(), BigInt::one());
    while &next > bound {
        let quotient = &r / &next;
        let (new, new_t) = (&r - &quotient * &next, &t - &quotient * &next_t);
        (r, next, t, next_t) = (next, new, next_t, new_t);
    }
    next_t.abs()
}

fn inverse_matrix(a: &[Vec<i128>]) -> Vec<Vec<u64>> {
    let size = a.len();
    let mut rows: Vec<Vec<u64>> = a
        .iter()
        .enumerate()
        .map(|(i, row)| {
            let residues = row.iter().map(|x| x.rem_euclid(i128::from(PRIME)) as u64);
            residues.chain((0..size).map(|j| u64::from(i == j))).collect()
        })
        .collect();
    for k in 0..size {
        let pivot = (k..size).find(|&i| rows[i][k] != 0).expect("independent features");
        rows.swap(k, pivot);
        let scale = inverse(rows[k][k]);
        rows[k].iter_mut().for_each(|x| *x = times(*x, scale));
        let pivot_row = rows[k].clone();
        let others = rows.iter_mut().enumerate().filter(|(i, row)| *i != k && row[k] != 0);
        for (_, row) in others {
            let factor = PRIME - row[k];
            for (x, p) in row.iter_mut().zip(&pivot_row) {
                *x = (*x + times(factor, *p)) % PRIME;
            }
        }
    }
    rows.into_iter().map(|row| row[size..].to_vec()).collect()
}
