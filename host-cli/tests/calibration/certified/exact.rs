//! Least squares in rational arithmetic, without any rounding.

use num_bigint::BigInt;
use num_rational::BigRational;

pub(crate) fn decimal(text: &str) -> BigRational {
    let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, "0"));
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits: BigInt = format!("{whole}{fraction}").parse().unwrap();
    let exponent = exponent.parse::<i32>().unwrap() - fraction.len() as i32;
    let power = BigInt::from(10).pow(exponent.unsigned_abs());
    if exponent >= 0 {
        BigRational::from_integer(digits * power)
    } else {
        BigRational::new(digits, power)
    }
}

pub(crate) fn binary(value: f64) -> BigRational {
    BigRational::from_float(value).unwrap()
}

/// Returns the nearest `f64` within two units in the last place, for any size of fraction.
pub(crate) fn to_f64(value: &BigRational) -> f64 {
    if *value.numer() == BigInt::ZERO {
        return 0.0;
    }
    let shift = 64 + value.denom().bits() as i64 - value.numer().bits() as i64;
    let quotient: BigInt = if shift >= 0 {
        (value.numer() << shift) / value.denom()
    } else {
        value.numer() / (value.denom() << -shift)
    };
    libm::ldexp(i128::try_from(quotient).unwrap() as f64, -shift as i32)
}

/// Columns of integers, each with the denominator that its elements share.
struct Integers {
    columns: Vec<Vec<BigInt>>,
    denominators: Vec<BigInt>,
}

fn integers(columns: &[Vec<BigRational>]) -> Integers {
    let denominator = |column: &Vec<BigRational>| {
        column.iter().fold(BigInt::from(1), |all, value| {
            let common = BigRational::new(all.clone(), value.denom().clone());
            // all / gcd · denominator, by way of the reduced fraction.
            common.numer() * value.denom()
        })
    };
    let denominators: Vec<BigInt> = columns.iter().map(denominator).collect();
    let scaled = columns.iter().zip(&denominators).map(|(column, d)| {
        column.iter().map(|value| value.numer() * (d / value.denom())).collect()
    });
    Integers { columns: scaled.collect(), denominators }
}

/// Returns the coefficients that minimise `‖X·C − Y‖`, by columns of `Y`, where row `i` counts
/// `times(i)` times; `None` if the columns of `X` are dependent. Uses Bareiss's fraction-free
/// elimination of `[XᵀX | XᵀY]`.
pub(crate) fn solve(
    x: &[Vec<BigRational>],
    y: &[Vec<BigRational>],
    times: impl Fn(usize) -> u64,
) -> Option<Vec<Vec<BigRational>>> {
    let (p, q) = (x.len(), y.len());
    let Integers { columns: x, denominators: x_units } = integers(x);
    let Integers { columns: y, denominators: y_units } = integers(y);
    let all: Vec<&Vec<BigInt>> = x.iter().chain(&y).collect();
    let dot = |a: &[BigInt], b: &[BigInt]| -> BigInt {
        a.iter().zip(b).enumerate().map(|(row, (a, b))| a * b * times(row)).sum()
    };
    let mut m: Vec<Vec<BigInt>> =
        (0..p).map(|i| (0..p + q).map(|j| dot(all[i], all[j])).collect()).collect();
    let mut previous = BigInt::from(1);
    for k in 0..p {
        let pivot = m[k][k].clone();
        // A zero pivot of a Gram matrix is a zero column of the rest.
        if pivot == BigInt::ZERO {
            return None;
        }
        for i in k + 1..p {
            for j in k + 1..p + q {
                m[i][j] = (&m[i][j] * &pivot - &m[i][k] * &m[k][j]) / &previous;
            }
        }
        previous = pivot;
    }
    // The determinant times the solution is whole: back substitution stays exact.
    let determinant = previous;
    let solution = (0..q).map(|a| {
        let mut c = vec![BigInt::ZERO; p];
        for i in (0..p).rev() {
            let known: BigInt = (i + 1..p).map(|k| &m[i][k] * &c[k]).sum();
            c[i] = (&m[i][p + a] * &determinant - known) / &m[i][i];
        }
        c.into_iter()
            .zip(&x_units)
            .map(|(c, unit)| BigRational::new(c * unit, &determinant * &y_units[a]))
            .collect()
    });
    Some(solution.collect())
}
