//! Outlines as absolute lines: paths in SVG path syntax, as figures have them, and rectangles.

use super::canvas::Outline;

/// A step of a path, in CSS pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    Move(f32, f32),
    Line(f32, f32),
    Close,
}

/// The steps of an outline; `None` if it has anything but lines.
pub(super) fn steps(outline: &Outline) -> Option<Vec<Step>> {
    let path = match outline {
        Outline::Path(path) => path,
        Outline::Rect(rect) => &rect.path(),
        Outline::Circle(..) => return None,
    };
    let (mut x, mut y) = (0.0, 0.0);
    let mut steps = Vec::new();
    for (command, numbers) in commands_of(path) {
        match (command, numbers.as_slice()) {
            ('M' | 'L', &[to_x, to_y]) => (x, y) = (to_x, to_y),
            ('l', &[by_x, by_y]) => (x, y) = (x + by_x, y + by_y),
            ('H', &[to_x]) => x = to_x,
            ('h', &[by_x]) => x += by_x,
            ('V', &[to_y]) => y = to_y,
            ('v', &[by_y]) => y += by_y,
            ('Z', []) => {
                steps.push(Step::Close);
                continue;
            }
            _ => return None,
        }
        steps.push(if command == 'M' { Step::Move(x, y) } else { Step::Line(x, y) });
    }
    Some(steps)
}

/// Commands, each with its numbers.
fn commands_of(path: &str) -> impl Iterator<Item = (char, Vec<f32>)> + '_ {
    let starts = path.char_indices().filter(|(_, c)| c.is_ascii_alphabetic());
    starts.map(|(at, command)| {
        let rest = &path[at + 1..];
        let end = rest.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(rest.len());
        let numbers = rest[..end].split([' ', ',']).filter_map(|number| number.parse().ok());
        (command, numbers.collect())
    })
}

#[cfg(test)]
mod tests {
    use super::Step::{Close, Line, Move};
    use super::*;

    #[test]
    fn paths_are_those_of_the_syntax() {
        let absolute =
            vec![Move(1.0, 2.0), Line(5.0, 2.0), Line(5.0, -3.0), Line(1.0, -3.0), Close];
        let steps = |path: &str| steps(&Outline::Path(path.to_owned()));
        assert_eq!(steps("M1 2H5V-3L1 -3Z"), Some(absolute.clone()));
        assert_eq!(steps("M1 2h4v-5l-4 0Z"), Some(absolute));
        assert_eq!(steps("M1 2C3 4"), None);
        assert_eq!(steps(""), Some(Vec::new()));
    }
}
