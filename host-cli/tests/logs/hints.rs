//! Hints that name an option. Each hint is followed for the file that caused it, and must give the right result.

use std::fs;
use std::path::Path;

use system_tests::program;

const ROWS: usize = 40;

/// A file, a failing command, its hint, the options that follow it, and texts of the output with these options.
struct HintCase {
    file: (&'static str, String),
    command: &'static str,
    hint: &'static str,
    followed: &'static str,
    right: &'static [&'static str],
}

fn rows(head: &str, row: impl Fn(usize) -> String) -> String {
    head.to_owned() + &(0..ROWS).map(|at| row(at) + "\n").collect::<String>()
}

fn six(at: usize, separator: &str) -> String {
    let of = |axis: usize| format!("{:.3}", ((at + axis) % 7) as f64 - 3.0);
    (0..6).map(of).collect::<Vec<_>>().join(separator)
}

fn cases() -> Vec<HintCase> {
    let dates = rows("time,s1,s2\n", |at| format!("03/04/2026 10:00:{at:02},{},7", 1500 + at));
    vec![
        HintCase {
            file: ("dates.csv", dates.clone()),
            command: "info dates.csv",
            hint: "`--unit time=d/m/y` or `--unit time=m/d/y`",
            followed: "--unit time=d/m/y",
            // `date -u -d 2026-04-03T10:00 +%s`
            right: &["1775210400.000000 s to 1775210439.000000 s", "1.00 Hz"],
        },
        HintCase {
            file: ("dates.csv", dates),
            command: "info dates.csv",
            hint: "begins with its day or with its month",
            followed: "--unit time=m/d/y",
            // `date -u -d 2026-03-04T10:00 +%s`
            right: &["1772618400.000000 s"],
        },
        HintCase {
            // `yarpdatadumper`: number, time since 1970, values.
            file: (
                "data.log",
                rows("", |at| format!("{at} {:.2} {}", 1.4e9 + at as f64 / 100.0, six(at, " "))),
            ),
            command: "info data.log",
            hint: "`--time 2 --wrench 3-8`",
            followed: "--time 2 --wrench 3-8",
            right: &["rows      40", "100.00 Hz", "Fx (N)", "Mz (N·m)"],
        },
        HintCase {
            // `ros2 topic echo --csv`: seconds, nanoseconds, frame, wrench.
            file: (
                "echo.csv",
                rows("", |at| format!("1700000000,{},ft,{}", 10_000_000 * at, six(at, ","))),
            ),
            command: "info echo.csv",
            hint: "`--time 1 --wrench 4-9`",
            followed: "--time 1 --wrench 4-9",
            right: &[
                "rows      40",
                "100.00 Hz",
                "Fx (N)",
                "Mz (N·m)",
                "sum of `column 1` and `column 2`",
            ],
        },
        HintCase {
            file: (
                "titled.csv",
                rows("rig 7, session 3\nby hand\n", |at| {
                    format!("{:.2},{},7,{}", at as f64 / 50.0, 1500 + at, 9 - at as i32)
                }),
            ),
            command: "info titled.csv",
            hint: "`--time 1 --sensors 2-4`",
            followed: "--time 1 --sensors 2-4",
            right: &["rows      40", "50.00 Hz", "sensor 3", "data from line 3"],
        },
        HintCase {
            // Two force plates in one export from Vicon.
            file: (
                "plates.csv",
                rows(
                    "Devices\n1000\n,,A - Force,,,A - Moment,,,B - Force,,,B - Moment,,\n\
                     Frame,Sub Frame,Fx,Fy,Fz,Mx,My,Mz,Fx,Fy,Fz,Mx,My,Mz\n\
                     ,,N,N,N,N.mm,N.mm,N.mm,N,N,N,N.mm,N.mm,N.mm\n",
                    |at| format!("{},{},{},{}", at / 10, at % 10, six(at, ","), six(at + 1, ",")),
                ),
            ),
            command: "info plates.csv",
            hint: "`--wrench 3-8` or `--wrench 9-14`",
            followed: "--wrench 9-14",
            right: &["rows      40", "1000.00 Hz", "Mx (N·m, from N·mm)"],
        },
        HintCase {
            file: ("steps.csv", rows("t,s1,s2\n", |at| format!("{},{},7", 500 * at, 1500 + at))),
            command: "info steps.csv",
            hint: "say it with `--time-unit`",
            followed: "--time-unit us",
            right: &["2000.00 Hz"],
        },
        HintCase {
            file: ("unit.csv", rows("t_s,Fx[volts],s1,s2\n", |at| format!("{at},1,2,{at}"))),
            command: "info unit.csv",
            hint: "`--unit 'Fx[volts]=UNIT'`",
            followed: "--unit Fx[volts]=lbf",
            right: &["Fx (N, from lbf)"],
        },
        HintCase {
            file: (
                "bad.csv",
                rows("t_s,s1,s2\n", |at| match at {
                    7 => "7,x,1".to_owned(),
                    _ => format!("{at},{},7", 1500 + at),
                }),
            ),
            command: "info bad.csv",
            hint: "leave such rows out with `--skip-bad-rows`",
            followed: "--skip-bad-rows",
            right: &["rows      39", "skipped   1 bad rows"],
        },
        HintCase {
            file: (
                "many.csv",
                rows("t_s,s1,fx_n\n", |at| match at % 4 {
                    0 => format!("{at},{},1", 1500 + at),
                    _ => format!("{at},{},", 1500 + at),
                }),
            ),
            command: "info many.csv --skip-bad-rows",
            hint: "30 of 40 rows are wrong, all in column `fx_n`",
            followed: "--skip-bad-rows=all",
            right: &["rows      10", "skipped   30 bad rows"],
        },
        HintCase {
            file: (
                "where.csv",
                rows("t_s,name,s1,s2\n", |at| format!("{at},{},{at},7", ["A", "B"][at % 2])),
            ),
            command: "info where.csv --where name=C",
            hint: "leave out a `--where` or `--exclude-group`",
            followed: "",
            right: &["rows      40", "choose one with `--where 'name=A'`"],
        },
        HintCase {
            file: (
                "where.csv",
                rows("t_s,name,s1,s2\n", |at| format!("{at},{},{at},7", ["A", "B"][at % 2])),
            ),
            command: "info where.csv --table run",
            hint: "leave out `--table`",
            followed: "--where name=A",
            right: &["rows      20", "0.50 Hz"],
        },
        HintCase {
            file: (
                "groups.csv",
                rows("t_s,group,s1,s2\n", |at| format!("{at},{},{at},7", ["A", "B"][at / 20])),
            ),
            command: "info groups.csv --exclude-group C",
            hint: "leave out one of its values: `A`, `B`",
            followed: "--exclude-group A",
            right: &["rows      20"],
        },
        HintCase {
            file: ("twice.csv", rows("t_s,Fx,Fx,Fy\n", |at| format!("{at},{at},7,8"))),
            command: "info twice.csv",
            hint: "`--wrench fx=2,…` or `fx=3,…`",
            followed: "--wrench fx=2,fy=4",
            right: &["2 Fx", "Fy (N)"],
        },
        HintCase {
            file: ("some.csv", rows("t_s,Fx (mN),Fy\n", |at| format!("{at},{at},7"))),
            command: "info some.csv",
            hint: "`--unit force=mN`, or `--unit 'Fy=N'`",
            followed: "--unit force=mN",
            right: &["Fy (N, from mN)"],
        },
        HintCase {
            file: ("nowhere.csv", rows("t_s,A,B\n", |at| format!("{at},{at},7"))),
            command: "info nowhere.csv --sensors A,C",
            hint: "name the columns with `--sensors`",
            followed: "--sensors A,B",
            right: &["sensor 2"],
        },
        HintCase {
            file: ("format.csv", rows("t_s,s1,s2\n", |at| format!("{at},{at},7"))),
            command: "info format.csv --format training",
            hint: "leave out `--format`",
            followed: "",
            right: &["sensor 2"],
        },
    ]
}

/// Removes the options that the hint rejects.
fn followed(command: &str, options: &str) -> String {
    let file = command.split_whitespace().take(2).collect::<Vec<_>>().join(" ");
    format!("{file} {options}")
}

#[test]
fn hints_that_name_an_option_lead_to_the_right_result() {
    let dir = tempfile::tempdir().unwrap();
    for HintCase { file: (name, text), command, hint, followed: options, right } in cases() {
        fs::write(dir.path().join(name), text).unwrap();
        let said = program::run(dir.path(), command, 2).replace('\n', " ");
        assert!(said.contains(hint), "`{command}`: no `{hint}` in\n{said}");
        let found = program::run(dir.path(), &followed(command, options), 0);
        for part in right {
            assert!(found.contains(part), "`{command}` with `{options}`: no `{part}` in\n{found}");
        }
    }
}

fn write_sparse_table(path: &Path) {
    use table_file::write::{Cells, write_matlab};
    let column = |of: &dyn Fn(usize) -> f64| (0..ROWS).map(of).collect::<Vec<f64>>();
    let columns = [
        ("t_s", column(&|at| at as f64)),
        ("s1", column(&|at| 1500.0 + at as f64)),
        ("fx_n", column(&|at| if at % 3 == 0 { f64::NAN } else { 1.0 })),
    ];
    let cells: Vec<(String, Cells<'_>)> = columns
        .iter()
        .map(|(name, values)| ((*name).to_owned(), Cells::Full(values.into())))
        .collect();
    write_matlab(&mut fs::File::create(path).unwrap(), &cells).unwrap();
}

#[test]
fn rows_of_tables_are_skipped_within_the_same_limit_as_those_of_texts() {
    let dir = tempfile::tempdir().unwrap();
    write_sparse_table(&dir.path().join("log.mat"));
    let said = program::run(dir.path(), "info log.mat --skip-bad-rows", 2).replace('\n', " ");
    let expected = "14 of 40 rows are wrong, all in column `fx_n`; the first at row 1:";
    assert!(said.contains(expected), "{said}");
    let said = program::run(dir.path(), "info log.mat --skip-bad-rows=all", 0);
    assert!(said.contains("rows      26"), "{said}");
}
