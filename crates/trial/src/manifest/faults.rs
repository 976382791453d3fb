//! Conflicts between the rows of a manifest: duplicates, and conditions that look mistyped.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::{CellPosition, Entry, Manifest, ManifestProblem};
use shell_data::hint::{did_you_mean, suggest};

impl Manifest {
    /// Rows in conflict, numbered from 0. Their window overlaps that of an earlier trial on the same log, or their
    /// condition is not in `declared` (without it, not in the manifest's conditions). `path_of` turns a file's name in
    /// the manifest into the one path of this log.
    pub fn faults(
        &self,
        declared: Option<&[String]>,
        path_of: impl Fn(&str) -> PathBuf,
    ) -> Vec<(usize, ManifestProblem)> {
        let declared = declared.or(self.conditions.as_deref());
        let mut faults = Vec::new();
        let mut before: BTreeMap<PathBuf, Vec<&Entry>> = BTreeMap::new();
        for (row, entry) in self.entries() {
            let file = path_of(&entry.trial.file);
            let twin = before.get(&file).into_iter().flatten().find(|e| overlap(e, entry));
            if let Some(twin) = twin {
                let message = format!(
                    "overlaps the trial of line {}: the same log from {} to {}",
                    twin.position.line,
                    moment(twin.enter.value),
                    moment(twin.exit.value)
                );
                faults.push((row, ManifestProblem::new(entry.enter.position, message)));
                continue;
            }
            before.entry(file).or_default().push(entry);
            let condition = &entry.trial.condition;
            if let Some(declared) = declared.filter(|known| !known.contains(condition)) {
                let hint = did_you_mean(condition, declared.iter().map(String::as_str));
                let message = format!("`{condition}` is none of the conditions{hint}");
                faults.push((row, ManifestProblem::new(entry.condition_position, message)));
            }
        }
        faults
    }

    /// Conditions that are probably mistyped: equal to another except for case, spaces and
    /// punctuation, or used once and one letter away from a more frequent one.
    pub fn suspicious(&self) -> Vec<ManifestProblem> {
        if self.conditions.is_some() {
            return Vec::new();
        }
        let mut seen: BTreeMap<&str, (usize, CellPosition)> = BTreeMap::new();
        for (_, entry) in self.entries() {
            seen.entry(&entry.trial.condition).or_insert((0, entry.condition_position)).0 += 1;
        }
        let mut remarks = Vec::new();
        for (&name, &(count, position)) in &seen {
            let others = seen.iter().filter(|(other, _)| **other != name);
            let like = others.filter(|(other, (often, _))| {
                let same = plain(name) == plain(other) && (*often, **other) > (count, name);
                let near = count == 1
                    && *often > 1
                    && name.chars().count() > 3
                    && digits(name) == digits(other)
                    && strsim::damerau_levenshtein(name, other) == 1;
                same || near
            });
            if let Some(other) = suggest(name, like.map(|(other, _)| *other)) {
                let message = format!("condition `{name}`, did you mean `{other}`?");
                remarks.push(ManifestProblem { position, message });
            }
        }
        remarks.sort_by_key(|problem| problem.position);
        remarks
    }

    /// The rows that are trials to be evaluated, with their numbers.
    fn entries(&self) -> impl Iterator<Item = (usize, &Entry)> {
        let rows = self.rows.iter().enumerate();
        rows.filter_map(|(row, entry)| Some((row, entry.as_ref().ok().filter(|e| !e.exclude)?)))
    }
}

fn overlap(a: &Entry, b: &Entry) -> bool {
    let span = |of: &Entry| {
        (of.enter.value.unwrap_or(f64::NEG_INFINITY), of.exit.value.unwrap_or(f64::INFINITY))
    };
    span(a).0 < span(b).1 && span(b).0 < span(a).1
}

fn moment(time_s: Option<f64>) -> String {
    time_s.map_or_else(|| "`auto`".to_owned(), |time_s| format!("`{time_s}` s"))
}

fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

fn digits(name: &str) -> String {
    name.chars().filter(char::is_ascii_digit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn manifest(rows: &str) -> Manifest {
        Manifest::parse(&format!("file,condition,t_enter_s,t_exit_s\n{rows}"), false).unwrap()
    }

    fn messages(problems: impl IntoIterator<Item = ManifestProblem>) -> Vec<String> {
        problems.into_iter().map(|problem| problem.to_string()).collect()
    }

    fn path_of(file: &str) -> PathBuf {
        file.trim_start_matches("./").into()
    }

    #[test]
    fn overlapping_trials_of_one_log_are_reported() {
        let manifest =
            manifest("a,x,1,3\nb,x,1,3\na,x,3,4\n./a,x,2.5,2.6\na,x,auto,0.5\nb,x,auto,auto\n");
        let faults =
            messages(manifest.faults(None, path_of).into_iter().map(|(_, problem)| problem));
        assert_eq!(
            faults,
            [
                "5:7: overlaps the trial of line 2: the same log from `1` s to `3` s",
                "7:5: overlaps the trial of line 3: the same log from `1` s to `3` s"
            ]
        );
    }

    #[test]
    fn undeclared_conditions_are_refused() {
        let manifest = manifest("a,free,1,3\nb,fre,1,3\n");
        let declared = ["free".to_owned(), "3 cm".to_owned()];
        let faults = messages(
            manifest.faults(Some(&declared), path_of).into_iter().map(|(_, problem)| problem),
        );
        assert_eq!(faults, ["3:3: `fre` is none of the conditions, did you mean `free`?"]);
    }

    #[test]
    fn likely_typing_errors_are_reported_and_distinct_conditions_are_not() {
        let slips =
            manifest("a,free,1,3\nb,free,1,3\nc,fere,1,3\nd,3 cm,1,3\ne,3cm,1,3\nf,3 cm,1,3\n");
        assert_eq!(
            messages(slips.suspicious()),
            [
                "4:3: condition `fere`, did you mean `free`?",
                "6:3: condition `3cm`, did you mean `3 cm`?"
            ]
        );
        let honest = manifest(
            "a,0,1,3\nb,0,1,3\nc,1,1,3\nd,free,1,3\ne,10 cm,1,3\nf,11 cm,1,3\ng,11 cm,1,3\n",
        );
        assert_eq!(messages(honest.suspicious()), [""; 0]);
    }
}
