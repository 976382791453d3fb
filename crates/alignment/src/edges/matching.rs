//! Pairs the edges of one recording with those of the other.
//!
//! Two nearby pairs of edges give a guess of offset and skew. The guess is followed through both recordings: each edge
//! is paired with the nearest one within reach, and the pairs correct the guess. An edge that only one side has costs
//! just its own pair.

/// The largest skew between a clock with a crystal and one without.
const MOST_SKEW: f64 = 2e-2;

/// Tolerance on an edge in addition to the reference's sampling interval, s: clocks wander.
const SLACK_S: f64 = 2e-4;

/// Number of board edges from which guesses start, and of the following edges to which each extends.
const BEGINNINGS: usize = 8;
const NEXT: usize = 3;

const CORRECTIONS: usize = 3;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pairing {
    pub(super) pairs: Vec<(usize, usize)>,
    line: ClockLine,
}

impl Pairing {
    fn goes_through(&self, guess: &ClockLine, blur_s: f64) -> bool {
        let ends = [guess.pivot_s, guess.pivot_s + guess.base_s];
        ends.iter().all(|&end| (self.line.at(end) - guess.at(end)).abs() <= blur_s + SLACK_S)
    }

    fn is_like(&self, other: &Self) -> bool {
        const LOOKED_AT: usize = 16;
        let step = self.pairs.len().div_ceil(LOOKED_AT);
        let looked_at = self.pairs.iter().step_by(step);
        let shared = looked_at.clone().filter(|&pair| other.pairs.binary_search(pair).is_ok());
        2 * shared.count() >= looked_at.count()
    }

    pub(super) fn offset_at(&self, board_s: f64) -> f64 {
        self.line.at(board_s) - board_s
    }
}

/// t_reference = at + (1 + skew) · (t_board − pivot).
#[derive(Clone, Copy, Debug, PartialEq)]
struct ClockLine {
    pivot_s: f64,
    at_s: f64,
    skew: f64,
    /// Time span from which the skew was determined, s.
    base_s: f64,
}

impl ClockLine {
    fn at(self, board_s: f64) -> f64 {
        self.at_s + (1.0 + self.skew) * (board_s - self.pivot_s)
    }

    fn reach(self, board_s: f64, blur_s: f64) -> f64 {
        let beyond = (board_s - self.pivot_s).abs() / self.base_s.max(1e-9);
        // Contribution to the skew of a blur at either end of the base.
        blur_s * (1.0 + 2.0 * beyond).min(4.0) + SLACK_S
    }

    fn through(pairs: &[(usize, usize)], reference: &[f64], board: &[f64]) -> Option<Self> {
        let n = pairs.len() as f64;
        let mean = |of: &dyn Fn(&(usize, usize)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
        let pivot_s = mean(&|&(_, i)| board[i]);
        let at_s = mean(&|&(j, _)| reference[j]);
        let (mut spread, mut together) = (0.0, 0.0);
        for &(j, i) in pairs {
            let (x, y) = (board[i] - pivot_s, reference[j] - at_s);
            spread += x * x;
            together += x * (y - x);
        }
        let base_s = board[pairs.last()?.1] - board[pairs.first()?.1];
        (spread > 0.0).then(|| Self { pivot_s, at_s, skew: together / spread, base_s })
    }
}

/// Possible pairings, the most pairs first; similar ones are merged.
pub(super) fn pairings(reference: &[f64], board: &[f64], blur_s: f64) -> Vec<Pairing> {
    let mut ways: Vec<Pairing> = Vec::new();
    let mut best = 1;
    for line in guesses(reference, board) {
        let is_known = |way: &Pairing| way.goes_through(&line, blur_s);
        if overlap(line, reference, board) * 2 <= best || ways.iter().any(is_known) {
            continue;
        }
        let Some(way) = follow(line, reference, board, blur_s) else { continue };
        if way.pairs.len() * 2 <= best {
            continue;
        }
        best = best.max(way.pairs.len());
        add(&mut ways, way);
    }
    if ways.is_empty() {
        // No gap between two edges occurs on both sides: any edge may match any other.
        ways = singles(reference, board);
    }
    ways.sort_by(|a, b| b.pairs.len().cmp(&a.pairs.len()).then(a.pairs.cmp(&b.pairs)));
    ways
}

fn guesses(reference: &[f64], board: &[f64]) -> impl Iterator<Item = ClockLine> {
    let step = board.len().div_ceil(BEGINNINGS).max(1);
    let starts = (0..board.len()).step_by(step);
    let seconds =
        starts.flat_map(move |i| (i + 1..board.len().min(i + 1 + NEXT)).map(move |k| (i, k)));
    seconds.flat_map(move |(i, k)| {
        let gap = board[k] - board[i];
        reference.iter().enumerate().flat_map(move |(j, &first)| {
            let least = first + gap * (1.0 - MOST_SKEW);
            let most = first + gap * (1.0 + MOST_SKEW) + SLACK_S;
            let from = reference.partition_point(|&time| time < least).max(j + 1);
            reference[from.min(reference.len())..]
                .iter()
                .take_while(move |&&time| time <= most)
                .map(move |&second| {
                    let skew = ((second - first) / gap - 1.0).clamp(-MOST_SKEW, MOST_SKEW);
                    ClockLine { pivot_s: board[i], at_s: first, skew, base_s: gap }
                })
        })
    })
}

fn overlap(line: ClockLine, reference: &[f64], board: &[f64]) -> usize {
    let [first, .., last] = reference else { return reference.len() };
    let from = board.partition_point(|&time| line.at(time) < first - SLACK_S);
    let to = board.partition_point(|&time| line.at(time) <= last + SLACK_S);
    // A guess whose skew is off by its blur may miss some edges.
    (to - from + 2).min(board.len()).min(reference.len())
}

fn follow(mut line: ClockLine, reference: &[f64], board: &[f64], blur_s: f64) -> Option<Pairing> {
    let mut pairs = walk(line, reference, board, blur_s);
    for _ in 0..CORRECTIONS {
        let corrected = ClockLine::through(&pairs, reference, board)?;
        if corrected.skew.abs() > MOST_SKEW {
            return None;
        }
        line = corrected;
        let again = walk(line, reference, board, blur_s);
        if again == pairs {
            break;
        }
        pairs = again;
    }
    (pairs.len() > 1).then_some(Pairing { pairs, line })
}

/// Pairs each edge of the board with the nearest of the reference within reach, if mutual.
fn walk(line: ClockLine, reference: &[f64], board: &[f64], blur_s: f64) -> Vec<(usize, usize)> {
    let mut pairs: Vec<(usize, usize, f64)> = Vec::new();
    for (i, &time) in board.iter().enumerate() {
        let expected = line.at(time);
        let after = reference.partition_point(|&edge| edge < expected);
        let candidates = [after.checked_sub(1), Some(after)].into_iter().flatten();
        let distance = |j: usize| Some((j, (reference.get(j)? - expected).abs()));
        let nearest = candidates.filter_map(distance).min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((j, off)) = nearest.filter(|&(_, off)| off <= line.reach(time, blur_s)) else {
            continue;
        };
        match pairs.last_mut() {
            Some(last) if last.0 == j && last.2 <= off => {}
            Some(last) if last.0 == j => *last = (j, i, off),
            _ => pairs.push((j, i, off)),
        }
    }
    pairs.into_iter().map(|(j, i, _)| (j, i)).collect()
}

/// Adds a pairing, unless an equivalent one exists; replaces an equivalent one with fewer pairs.
fn add(ways: &mut Vec<Pairing>, way: Pairing) {
    match ways.iter_mut().find(|other| way.is_like(other) || other.is_like(&way)) {
        Some(other) if other.pairs.len() >= way.pairs.len() => {}
        Some(other) => *other = way,
        None => ways.push(way),
    }
}

fn singles(reference: &[f64], board: &[f64]) -> Vec<Pairing> {
    let pair = |j: usize, i: usize| Pairing {
        pairs: vec![(j, i)],
        line: ClockLine { pivot_s: board[i], at_s: reference[j], skew: 0.0, base_s: f64::INFINITY },
    };
    let pairs = (0..reference.len()).flat_map(|j| (0..board.len()).map(move |i| (j, i)));
    // Beyond this limit the number does not matter.
    pairs.take(1 << 12).map(|(j, i)| pair(j, i)).collect()
}
