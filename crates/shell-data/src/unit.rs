//! Units of measurement as people write them: `N`, `mN·m`, `lbf-in`, `mm.N`, `kgf cm`, `m/s^2`, `milliseconds`.
//!
//! A unit is a product of symbols with prefixes and exponents. Factors are separated by any mark or none: `N-m`, `N m`,
//! `N.m`, `N*m`, `N·m` and `Nm` are the same unit. A digit after a `-` is an exponent (`m s-2`). Case distinguishes
//! `MN` from `mN`. If nothing matches (`fx_n`, `LBF`), the case of symbols is ignored, but not of prefixes. The
//! expected quantity resolves other ambiguities: `nm` is a moment. `g` is an acceleration or, as a force, the weight of
//! a gram; other masses (`kg`, `lb`, `oz`) are weights, too. Units of other quantities, such as `N/mm` for a moment,
//! are rejected.

use crate::wrench::Axis;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Force, N.
    Force,
    /// Moment, N·m.
    Moment,
    /// Time, s.
    Time,
    /// Angle, rad.
    Angle,
    /// Acceleration, m/s².
    Acceleration,
    /// Mass, kg.
    Mass,
    /// Length, m.
    Length,
    /// A number without a dimension, such as a duty.
    Share,
    /// Electric potential, V.
    Voltage,
    /// Electric current, A.
    Current,
    /// Power, W.
    Power,
}

impl Quantity {
    pub const fn of_axis(axis: Axis) -> Self {
        if axis.is_moment() { Self::Moment } else { Self::Force }
    }

    pub const fn name(self) -> &'static str {
        match self {
            Self::Force => "force",
            Self::Moment => "moment",
            Self::Time => "time",
            Self::Angle => "angle",
            Self::Acceleration => "acceleration",
            Self::Mass => "mass",
            Self::Length => "length",
            Self::Share => "share",
            Self::Voltage => "voltage",
            Self::Current => "current",
            Self::Power => "power",
        }
    }

    /// Returns examples of accepted units.
    pub const fn understood(self) -> &'static str {
        match self {
            Self::Force => "N, mN, kN, lbf, ozf, gf, kgf, dyn",
            Self::Moment => "N·m, mN·m, N·mm, N·cm, lbf·in, lbf·ft, ozf·in, kgf·cm, gf·cm",
            Self::Time => "s, ms, µs, ns, min, h",
            Self::Angle => "rad, mrad, deg, rev",
            Self::Acceleration => "m/s², g, mg",
            Self::Mass => "kg, g, mg, lb, oz",
            Self::Length => "mm, cm, m, in, ft",
            Self::Share => "1, %",
            Self::Voltage => "V, mV",
            Self::Current => "A, mA",
            Self::Power => "W, mW",
        }
    }

    const fn dimension(self) -> Dimension {
        match self {
            Self::Force => FORCE,
            Self::Moment => [1, 2, -2, 0, 0],
            Self::Time => TIME,
            Self::Angle => ANGLE,
            Self::Acceleration => ACCELERATION,
            Self::Mass => MASS,
            Self::Length => LENGTH,
            Self::Share => SHARE,
            Self::Voltage => VOLTAGE,
            Self::Current => CURRENT,
            Self::Power => POWER,
        }
    }
}

type Dimension = [i8; 5];
const MASS: Dimension = [1, 0, 0, 0, 0];
const LENGTH: Dimension = [0, 1, 0, 0, 0];
const TIME: Dimension = [0, 0, 1, 0, 0];
const ANGLE: Dimension = [0, 0, 0, 1, 0];
const CURRENT: Dimension = [0, 0, 0, 0, 1];
const SHARE: Dimension = [0; 5];
const FORCE: Dimension = [1, 1, -2, 0, 0];
const ACCELERATION: Dimension = [0, 1, -2, 0, 0];
const POWER: Dimension = [1, 2, -3, 0, 0];
const VOLTAGE: Dimension = [1, 2, -3, 0, -1];

/// A conversion to SI units: `value · times / per`. Powers of ten below one are divisors: a division rounds
/// correctly, a multiplication by the inverse does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// A factor, 1 for the metric units.
    pub times: f64,
    /// A divisor, 1 or a power of ten.
    pub per: f64,
}

impl Scale {
    pub const ONE: Self = Self { times: 1.0, per: 1.0 };

    /// Returns the scale of a unit that is `per` times smaller than the SI unit.
    pub const fn per_si(per: f64) -> Self {
        Self { times: 1.0, per }
    }

    pub fn to_si(self, value: f64) -> f64 {
        value * self.times / self.per
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Unit {
    /// The standard spelling: `mN·m`, `lbf·in`.
    pub symbol: String,
    pub scale: Scale,
}

impl Unit {
    pub fn parse(text: &str, quantity: Quantity) -> Option<Self> {
        let time = || text.split(" since ").next().unwrap_or(text);
        let text = if quantity == Quantity::Time { time() } else { text };
        if quantity == Quantity::Share && text.trim() == "1" {
            return Some(Self { symbol: "1".to_owned(), scale: Scale::ONE });
        }
        let factors = factors(text)?;
        let dimension = quantity.dimension();
        let mut wanted = vec![(dimension, false)];
        // If a force or moment is expected, a mass means its weight.
        if matches!(quantity, Quantity::Force | Quantity::Moment) {
            wanted.push((std::array::from_fn(|of| dimension[of] - ACCELERATION[of]), true));
        }
        [false, true].into_iter().find_map(|folded| {
            let products = products(&factors, folded);
            wanted.iter().find_map(|&(dimension, is_weight)| {
                let product = products.iter().find(|product| product.dimension == dimension)?;
                Some(product.unit(is_weight))
            })
        })
    }

    /// Returns true if `text` is a unit, including units of length or mass.
    pub fn is_spelled(text: &str) -> bool {
        factors(text).is_some_and(|all| {
            [false, true].iter().any(|&folded| !products(&all, folded).is_empty())
        })
    }
}

/// A symbol: its names, the first for output; dimension; size (a factor, a power of ten); allowed prefixes.
struct Symbol(&'static [&'static str], Dimension, f64, i32, &'static str);

/// The pound is 0.45359237 kg and the inch 0.0254 m (international yard and pound agreement, 1959),
/// standard gravity 9.80665 m/s² (3rd CGPM, 1901).
const SYMBOLS: [Symbol; 25] = [
    Symbol(&["N", "newton"], FORCE, 1.0, 0, "nµumcdDkMG"),
    Symbol(&["lbf", "lbsf"], FORCE, 4.448_221_615_260_5, 0, "k"),
    Symbol(&["kip"], FORCE, 4.448_221_615_260_5, 3, ""),
    Symbol(&["ozf"], FORCE, 4.448_221_615_260_5 / 16.0, 0, ""),
    Symbol(&["gf", "pond"], FORCE, 9.806_65, -3, "mk"),
    Symbol(&["kp"], FORCE, 9.806_65, 0, ""),
    Symbol(&["dyn", "dyne"], FORCE, 1.0, -5, ""),
    Symbol(&["g", "gram", "gramme"], MASS, 1.0, -3, "mk"),
    Symbol(&["lb", "lbs", "pound"], MASS, 0.453_592_37, 0, ""),
    Symbol(&["oz", "ounce"], MASS, 0.028_349_523_125, 0, ""),
    Symbol(&["m", "meter", "metre"], LENGTH, 1.0, 0, "µumcd"),
    Symbol(&["in", "inch", "inches"], LENGTH, 0.0254, 0, ""),
    Symbol(&["ft", "foot", "feet"], LENGTH, 0.3048, 0, ""),
    Symbol(&["s", "sec", "second", "sekunde", "sekunden", "seconde"], TIME, 1.0, 0, "nµum"),
    Symbol(&["min", "minute"], TIME, 60.0, 0, ""),
    Symbol(&["h", "hr", "hour"], TIME, 3600.0, 0, ""),
    Symbol(&["d", "day"], TIME, 86_400.0, 0, ""),
    Symbol(&["rad", "radian"], ANGLE, 1.0, 0, "µum"),
    Symbol(&["°", "deg", "degree"], ANGLE, std::f64::consts::PI / 180.0, 0, ""),
    Symbol(&["rev", "revolution"], ANGLE, std::f64::consts::TAU, 0, ""),
    Symbol(&["g", "gee", "gn"], ACCELERATION, 9.806_65, 0, "µum"),
    Symbol(&["%", "percent", "pct"], SHARE, 1.0, -2, ""),
    Symbol(&["V", "volt"], VOLTAGE, 1.0, 0, "µumk"),
    Symbol(&["A", "amp", "ampere"], CURRENT, 1.0, 0, "nµum"),
    Symbol(&["W", "watt"], POWER, 1.0, 0, "µumk"),
];

/// Prefixes: the character for [`SYMBOLS`], the spellings, and the power of ten.
const PREFIXES: [(char, &[&str], i32); 10] = [
    ('n', &["n", "nano"], -9),
    ('µ', &["µ", "micro", "mikro"], -6),
    ('u', &["u"], -6),
    ('m', &["m", "milli"], -3),
    ('c', &["c", "centi"], -2),
    ('d', &["d", "deci"], -1),
    ('D', &["da", "deca", "deka"], 1),
    ('k', &["k", "K", "kilo"], 3),
    ('M', &["M", "mega"], 6),
    ('G', &["G", "giga"], 9),
];

/// Abbreviations of units of time (`millis` for milliseconds), with their symbols and powers of ten.
const SHORT_TIMES: [(&str, &str, i32); 3] =
    [("millis", "ms", -3), ("micros", "µs", -6), ("nanos", "ns", -9)];

#[derive(Clone, Debug)]
struct Product {
    dimension: Dimension,
    times: f64,
    tens: i32,
    symbol: String,
}

impl Product {
    fn new((dimension, times, tens): (Dimension, f64, i32), symbol: String) -> Self {
        Self { dimension, times, tens, symbol }
    }

    fn raised(&self, exponent: i8) -> Self {
        let power = match exponent {
            1 => "",
            2 => "²",
            -1 => "⁻¹",
            -2 => "⁻²",
            // No supported quantity has other exponents.
            _ => "ⁿ",
        };
        let symbol = format!("{}{power}", self.symbol);
        let dimension = self.dimension.map(|of| of.saturating_mul(exponent));
        let times = self.times.powi(exponent.into());
        Self { dimension, times, tens: self.tens * i32::from(exponent), symbol }
    }

    fn and(&self, other: &Self) -> Self {
        let dimension =
            std::array::from_fn(|of| self.dimension[of].saturating_add(other.dimension[of]));
        let symbol = [self.symbol.as_str(), other.symbol.as_str()].join("·");
        Self::new((dimension, self.times * other.times, self.tens + other.tens), symbol)
    }

    /// Returns the unit. A mass that is used as a weight gets an `f` in the symbol: `kgf`.
    fn unit(&self, is_weight: bool) -> Unit {
        let (mut times, mut symbol) = (self.times, self.symbol.clone());
        if is_weight {
            times *= 9.806_65;
            let weight = |factor: &str| match factor {
                "g" | "mg" | "kg" | "lb" | "oz" => format!("{factor}f"),
                other => other.to_owned(),
            };
            symbol = symbol.split('·').map(weight).collect::<Vec<_>>().join("·");
        }
        let power = 10_f64.powi(self.tens.abs());
        let scale = match self.tens < 0 {
            true => Scale { times, per: power },
            false => Scale { times: times * power, per: 1.0 },
        };
        Unit { symbol, scale }
    }
}

const MOST_FACTORS: usize = 6;

/// Returns true for the characters of the names of units.
pub fn is_letter(character: char) -> bool {
    character.is_alphabetic() || matches!(character, '°' | '%')
}

/// Splits a unit into words and their exponents; `None` if it is not a unit.
fn factors(text: &str) -> Option<Vec<(String, i8)>> {
    let text: String = text.trim().chars().filter_map(plain_mark).collect();
    let text = text.replace("**", "^");
    let (mut factors, mut sign) = (Vec::<(String, i8)>::new(), 1_i8);
    let mut rest = text.as_str();
    // A factor may follow a mark or a word, but an exponent must follow a word.
    let mut is_behind_word = false;
    while let Some(first) = rest.chars().next() {
        let length = |is: fn(char) -> bool| rest.find(|c| !is(c)).unwrap_or(rest.len());
        if is_letter(first) {
            let (word, after) = rest.split_at(length(is_letter));
            rest = after;
            is_behind_word = false;
            match word.to_lowercase().as_str() {
                "per" if !factors.is_empty() => sign = -1,
                // `pound force`, `lb-f`, `kilogram-force`: a mass already means its weight.
                "force" | "f" if !factors.is_empty() => {}
                _ if factors.len() == MOST_FACTORS => return None,
                _ => {
                    let word =
                        word.strip_suffix("force").filter(|it| !it.is_empty()).unwrap_or(word);
                    factors.push((word.to_owned(), std::mem::replace(&mut sign, 1)));
                    is_behind_word = true;
                }
            }
            // `squared` and `cubed` follow the factor that they raise.
            let power = ["squared", "cubed"].iter().position(|it| word.eq_ignore_ascii_case(it));
            if let Some(power) = power {
                factors.pop();
                let raised = factors.last_mut()?;
                raised.1 = raised.1.checked_mul(2 + power as i8)?;
            }
            continue;
        }
        let digits = rest.strip_prefix('^').unwrap_or(rest);
        let unsigned = digits.strip_prefix('-').unwrap_or(digits);
        if unsigned.starts_with(|c: char| c.is_ascii_digit()) {
            let end = unsigned.find(|c: char| !c.is_ascii_digit()).unwrap_or(unsigned.len());
            let exponent: i8 = unsigned[..end].parse().ok().filter(|of| (1..=4).contains(of))?;
            let exponent = if unsigned.len() < digits.len() { -exponent } else { exponent };
            let raised = factors.last_mut().filter(|_| is_behind_word)?;
            raised.1 *= exponent;
            rest = &unsigned[end..];
            is_behind_word = false;
            continue;
        }
        match first {
            '/' if sign == 1 && !factors.is_empty() => sign = -1,
            ' ' | '.' | '*' | '-' | '_' => {}
            _ => return None,
        }
        is_behind_word = false;
        rest = &rest[first.len_utf8()..];
    }
    (!factors.is_empty() && sign == 1 && !rest.ends_with('^')).then_some(factors)
}

/// Converts a character to the form that the grammar uses; `None` for brackets.
fn plain_mark(mark: char) -> Option<char> {
    Some(match mark {
        '(' | ')' | '[' | ']' => return None,
        '·' | '⋅' | '∙' | '•' | '×' | '\u{2062}' | '\u{a0}' => '*',
        'μ' => 'µ',
        '−' | '–' | '‑' | '⁻' => '-',
        '¹' => '1',
        '²' => '2',
        '³' => '3',
        other => other,
    })
}

/// Returns the possible meanings of a list of factors, the most literal first.
fn products(factors: &[(String, i8)], folded: bool) -> Vec<Product> {
    let mut products: Vec<Product> = Vec::new();
    for (at, (word, exponent)) in factors.iter().enumerate() {
        let of_word = words(word, folded);
        let raised = of_word.iter().map(|product| product.raised(*exponent));
        products = match at {
            0 => raised.collect(),
            _ => {
                let raised: Vec<Product> = raised.collect();
                let pairs = products.iter().flat_map(|left| raised.iter().map(|it| left.and(it)));
                pairs.collect()
            }
        };
    }
    products
}

/// Returns the possible meanings of a word as a symbol with a prefix, or else as two symbols without a separator.
fn words(word: &str, folded: bool) -> Vec<Product> {
    let mut found = symbols(word, folded);
    if !found.is_empty() {
        return found;
    }
    let cuts = word.char_indices().skip(1).map(|(at, _)| at);
    for (left, right) in cuts.map(|at| word.split_at(at)) {
        let rights = symbols(right, folded);
        found.extend(symbols(left, folded).iter().flat_map(|l| rights.iter().map(|r| l.and(r))));
    }
    found
}

/// Returns the possible meanings of a word as one symbol with a prefix.
fn symbols(word: &str, folded: bool) -> Vec<Product> {
    // Names longer than three letters are case-insensitive. All but one-letter names may be plurals.
    let is_same = |text: &str, name: &str| {
        let same = |text: &str| match folded || name.len() > 3 {
            true => text.to_lowercase() == name.to_lowercase(),
            false => text == name,
        };
        same(text) || (name.len() > 1 && text.strip_suffix(['s', 'S']).is_some_and(same))
    };
    let mut found = Vec::new();
    for Symbol(names, dimension, times, tens, prefixes) in &SYMBOLS {
        let is_name = |text: &str| names.iter().any(|name| is_same(text, name));
        if is_name(word) {
            found.push(Product::new((*dimension, *times, *tens), names[0].to_owned()));
        }
        for (key, spellings, power) in PREFIXES.iter().filter(|it| prefixes.contains(it.0)) {
            // If case is ignored, `M` may be mega or milli.
            if folded && *key == 'M' {
                continue;
            }
            let stem = |spelling: &&str| {
                let (prefix, stem) = word.split_at_checked(spelling.len())?;
                let is_word = spelling.len() > 2 && prefix.eq_ignore_ascii_case(spelling);
                (is_word || prefix == *spelling).then_some(stem)
            };
            if spellings.iter().filter_map(stem).any(is_name) {
                let shown = if *key == 'u' { "µ" } else { spellings[0] };
                let symbol = format!("{shown}{}", names[0]);
                found.push(Product::new((*dimension, *times, tens + power), symbol));
            }
        }
    }
    let short = SHORT_TIMES.iter().filter(|(name, ..)| word.eq_ignore_ascii_case(name));
    found
        .extend(short.map(|&(_, symbol, tens)| Product::new((TIME, 1.0, tens), symbol.to_owned())));
    found
}
