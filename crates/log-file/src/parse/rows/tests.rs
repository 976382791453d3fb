use proptest::prelude::*;
use shell_data::instructions::{arch, available};

use super::*;

const NUMBERS: usize = 2;

fn plan() -> RowPlan {
    let names = ["time", "group", "talk", "fx"].map(str::to_owned).to_vec();
    let uses =
        vec![ColumnUse::Number(None), ColumnUse::Skip, ColumnUse::Skip, ColumnUse::Number(None)];
    RowPlan { separator: b',', uses, labels: vec![2, 1], names, head: None }
}

fn parse(instructions: Arch, lines: &[u8], skip: bool) -> (Result<(), RowError>, ParsedRows) {
    let mut parsed = ParsedRows::default();
    parsed.clear(NUMBERS, 0);
    let result = plan().parse_lines(instructions, lines, skip, &mut parsed);
    parsed.finish();
    parsed.ends = FieldEnds::default();
    (result, parsed)
}

/// Parses row by row, from the fields that [`slice::split`] finds.
fn parse_slowly(lines: &[u8], skip: bool) -> (Result<(), RowError>, ParsedRows) {
    let plan = plan();
    let mut parsed = ParsedRows::default();
    parsed.clear(NUMBERS, 0);
    let mut offset = 0;
    for line in lines.split(|&byte| byte == b'\n') {
        let text = line.strip_suffix(b"\r").unwrap_or(line);
        if !text.trim_ascii().is_empty() && !is_comment(text) {
            let fields = text.split(|&byte| byte == plan.separator);
            let is_last = offset + line.len() == lines.len();
            match plan.parse_fields(fields, &mut parsed) {
                Ok(()) => parsed.rows += 1,
                Err(problem) if skip || (is_last && plan.is_short(&problem)) => {
                    parsed.skip(offset, problem);
                    parsed.pass_lines(1);
                }
                Err(problem) => return (Err(RowError { offset, problem }), parsed),
            }
        } else if offset < lines.len() {
            parsed.pass_lines(1);
        }
        offset += line.len() + 1;
    }
    parsed.finish();
    (Ok(()), parsed)
}

#[test]
fn a_frame_without_its_reference_is_left_out_and_counted() {
    let lines = b"1,7\n2,\n3,x\n";
    let uses = vec![ColumnUse::Skip, ColumnUse::Number(None)];
    let plan = |names: [&str; 2]| {
        let names = names.map(str::to_owned).to_vec();
        RowPlan { separator: b',', uses: uses.clone(), labels: Vec::new(), names, head: None }
    };
    for (names, wrong) in
        [(["ref_index", "fx_n"], 7), (["index", "fx_n"], 4), (["ref_index", "s1"], 4)]
    {
        let mut parsed = ParsedRows::default();
        parsed.clear(1, 0);
        let error = plan(names).parse_lines(arch(), lines, false, &mut parsed).unwrap_err();
        assert_eq!((error.offset, parsed.skipped), (wrong, u64::from(wrong == 7)));
    }
}

fn assert_all_ways_agree(lines: &[u8]) {
    for skip in [false, true] {
        let (result, expected) = parse_slowly(lines, skip);
        for (name, instructions) in available() {
            let (found, parsed) = parse(instructions, lines, skip);
            assert_eq!(found, result, "{name}: {:?}", String::from_utf8_lossy(lines));
            if result.is_ok() {
                assert_eq!(bits(&parsed), bits(&expected));
                assert_eq!(parsed, expected, "{:?}", String::from_utf8_lossy(lines));
            }
        }
    }
}

fn bits(parsed: &ParsedRows) -> Vec<Vec<u64>> {
    parsed.columns.iter().map(|c| c.iter().map(|value| value.to_bits()).collect()).collect()
}

fn rows() -> impl Strategy<Value = String> {
    let number = "-?[0-9]{1,18}(\\.[0-9]{1,17})?|-?[0-9]{3,4}|-?0\\.0?[0-9]{11,13}";
    let line_end = prop_oneof![9 => Just("\n"), 2 => Just("\r\n"), 1 => Just("\n\n")];
    let odd = "[-+.eE0-9 ,x\r]{0,40}";
    let row = prop_oneof![
        30 => (number, "[ab]", "[a-z0-9.]{0,70}", number)
            .prop_map(|(a, b, c, d)| format!("{a},{b},{c},{d}")),
        1 => odd.prop_map(String::from),
        1 => (odd, number).prop_map(|(a, d)| format!("{a},a,,{d}")),
    ];
    let line = (row, line_end).prop_map(|(row, end)| row + end);
    (proptest::collection::vec(line, 0..300), any::<bool>()).prop_map(|(lines, open)| {
        let text = lines.concat();
        if open { text.trim_end().to_owned() } else { text }
    })
}

proptest! {
    #[test]
    fn rows_are_read_as_one_by_one_on_any_processor(text in rows()) {
        assert_all_ways_agree(text.as_bytes());
    }

    #[test]
    fn any_bytes_are_read_as_one_by_one_on_any_processor(
        bytes in proptest::collection::vec(
            prop_oneof![8 => proptest::sample::select(&b"0123456789.-,\n\r"[..]),
                        1 => any::<u8>().prop_filter("no quote", |&byte| byte != b'"')],
            0..400,
        )
    ) {
        assert_all_ways_agree(&bytes);
    }
}

#[test]
fn a_carriage_return_within_a_line_ends_no_row() {
    for quoted in ["5,g,\"x\",6\r\n", "5,g,x\"y,6\r\n", ""] {
        let lines = format!("1,g,x,2\r\n3,g,x,4\r5,g,x,6\r\n{quoted}");
        let (result, parsed) = parse(arch(), lines.as_bytes(), false);
        let error = result.unwrap_err();
        assert_eq!((error.offset, parsed.rows), (9, 1), "{quoted}");
        assert!(matches!(error.problem, RowProblem::ColumnCount { expected: 4, found: 7 }));
    }
    let ends = "1,g,\"x\",2\r\n3,\"h\",x,\"4\"\r\n";
    let (result, parsed) = parse(arch(), ends.as_bytes(), false);
    assert!(result.is_ok());
    assert_eq!(parsed.columns[1][..2], [2.0, 4.0]);
}

#[test]
fn quotes_around_whole_fields_say_nothing() {
    let plain = "1,a,x,2\r\n\n3,b,,4.5\n-0.25,b,y,17";
    for quoted in [
        "\"1\",\"a\",\"x\",\"2\"\r\n\"\"\n3,\"b\",\"\",\"4.5\"\n\"-0.25\",b,y,\"17\"",
        // One pair of quotes encloses a separator, so all lines are parsed one by one.
        "1,a,\"x\",2\r\n\n3,\"b\",,4.5\n-0.25,b,\"y\",17\n\"# a \"\"remark\"\"\",\"a,b\"",
    ] {
        for (name, instructions) in available() {
            let (result, found) = parse(instructions, quoted.as_bytes(), true);
            let (_, expected) = parse(instructions, plain.as_bytes(), true);
            assert!(result.is_ok(), "{name}");
            assert_eq!((found.rows, &found.labels), (3, &expected.labels), "{name}");
            assert_eq!(bits(&found), bits(&expected), "{name}");
        }
    }
    let wrong = "\"1\",\"a\",\"x\",\"2\"\r\n\"oops\",a,,2\n";
    let error = parse(arch(), wrong.as_bytes(), false).0.unwrap_err();
    assert_eq!(error.offset, 17);
    assert!(matches!(error.problem, RowProblem::Field { column: 0, found, .. } if found == "oops"));
}

#[test]
fn readings_that_no_converter_gives_and_loads_that_no_sensor_measures_are_wrong() {
    let uses =
        [None, Some(Limit::LOGGED_READING), Some(Limit::LOAD)].map(ColumnUse::Number).to_vec();
    let names = ["t", "s1", "fx"].map(str::to_owned).to_vec();
    let labels = vec![1];
    let plan = RowPlan { separator: b',', uses, labels, names, head: None };
    let right = "1e63,1063,-1e15\n";
    for position in [0, 1, 40, 300] {
        for wrong in ["1,1e63,0", "1,-65536,0", "1,65535.1,0", "1,0,1e200", "1,0,-1.1e15"] {
            let lines = format!("{}{wrong}\n{right}", right.repeat(position));
            let mut parsed = ParsedRows::default();
            parsed.clear(3, 0);
            let error = plan.parse_lines(arch(), lines.as_bytes(), false, &mut parsed).unwrap_err();
            let RowProblem::Field { problem, .. } = &error.problem else { panic!("{error:?}") };
            let is_unbelievable = matches!(problem, FieldProblem::BeyondLimit(_));
            assert!(is_unbelievable, "{error:?}");
            assert_eq!(error.offset, position * right.len());
            parsed.clear(3, 0);
            plan.parse_lines(arch(), lines.as_bytes(), true, &mut parsed).unwrap();
            assert_eq!((parsed.rows, parsed.skipped), (position + 1, 1));
        }
    }
}

#[test]
fn a_last_row_that_is_cut_off_is_left_out() {
    for (lines, rows, is_right) in [
        ("1,a,,2\n3,a", 1, true),
        ("1,a,,2\n3,\"a\",", 1, true),
        ("1,a,,2\n3,a,,4", 2, true),
        ("1,a,,2\n3,a\n", 1, false),
        ("1,a,,2\n3,a,,4,5", 1, false),
        ("1,a,,2\n3,a,,", 1, true),
        ("1,a,,2\n,a,,4", 1, false),
    ] {
        let (result, parsed) = parse(Arch::Scalar, lines.as_bytes(), false);
        assert_eq!((parsed.rows, result.is_ok()), (rows, is_right), "{lines}");
    }
}

#[test]
fn a_bad_row_anywhere_among_many_is_found() {
    let right = "1425168310.852012,a,,-0.0630686291217\n";
    for position in 0..300 {
        for wrong in ["1,a,,x\n", "x,a,,1\n", "1,a,1\n", "1,a,,2,\n", "1,a,,.\n", "\n"] {
            let lines = right.repeat(position) + wrong + &right.repeat(3);
            assert_all_ways_agree(lines.as_bytes());
        }
    }
}
