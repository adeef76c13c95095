use super::*;
use crate::record::{Stamp, TrajectoryPoint};
use proptest::prelude::*;

fn rules(tolerances: &[&str], ignored: &[&str]) -> Rules {
    Rules {
        tolerances: tolerances.iter().map(|t| t.parse().unwrap()).collect(),
        ignored: ignored.iter().map(|t| Pattern::new(t)).collect(),
    }
}

fn tables(a: &str, b: &str, key: Option<&str>, rules: &Rules) -> Result<Comparison, DiffError> {
    table::compare(a.as_bytes(), b.as_bytes(), ["a", "b"], key, rules)
}

/// Nothing for equal texts, else what is said of them.
fn said(a: &str, b: &str, rules: &Rules) -> String {
    let mut comparison = tables(a, b, None, rules).unwrap();
    if comparison.is_equal() {
        String::new()
    } else {
        comparison.text()
    }
}

#[test]
fn patterns_take_a_star_for_anything() {
    for (pattern, name, fits) in [
        ("x_m", "x_m", true),
        ("x_m", "xx_m", false),
        ("*_m", "x_m", true),
        ("*_m", "x_mm", false),
        ("cov_*", "cov_x_x", true),
        ("cov_*_x", "cov_yaw_x", true),
        ("cov_*_x", "cov_x", false),
        ("*", "", true),
        ("a*a", "a", false),
        ("rms_mm", "runs.0.x.rms_mm", true),
        ("runs.*.n", "runs.0.x.n", true),
        ("n", "runs.0.x.nn", false),
    ] {
        assert_eq!(Pattern::new(pattern).is_of(name), fits, "{pattern} {name}");
    }
}

#[test]
fn tolerances_are_absolute_or_relative() {
    for text in [
        "x_m", "x_m=", "=1", "x_m=-1", "x_m=nan", "x_m=inf", "x_m=1%%", "x_m=one",
    ] {
        let error = text.parse::<Tolerance>().unwrap_err().to_string();
        assert!(error.contains("x_m=1e-6"), "{error}");
    }
    let (a, b) = ("x_m,y_m\n1,100\n", "x_m,y_m\n1.001,100.9\n");
    assert!(!said(a, b, &rules(&["*=0"], &[])).is_empty());
    assert_eq!(said(a, b, &rules(&["*=1%"], &[])), "");
    assert_eq!(
        said(a, b, &rules(&["*=0", "x_m=0.0011", "y_m=0.91"], &[])),
        ""
    );
    // The last one that fits holds.
    assert!(!said(a, b, &rules(&["x_m=0.0011", "y_m=0.91", "*=0"], &[])).is_empty());
}

#[test]
fn a_difference_has_a_place_and_a_size() {
    let a = "stamp_ns,x_m,status\n1,0.5,ok\n2,1.25,ok\n3,2,ok\n";
    let b = "stamp_ns,x_m,status\n1,0.5,ok\n2,1.5,no-yaw\n3,2.5,ok\n";
    assert_eq!(
        said(a, b, &Rules::default()),
        "a and b differ in 2 rows of 3, 3 fields\n  \
         x_m: 2 differences, the first in row 2 (line 3): 1.25 and 1.5; the largest 5e-1 in row 3 \
         (line 4)\n  status: 1 difference, the first in row 2 (line 3): \"ok\" and \"no-yaw\"\n"
    );
    assert_eq!(said(a, b, &rules(&["x_m=0.5"], &["status"])), "");
    let mut within = tables(a, b, None, &rules(&["x_m=0.5"], &["status"])).unwrap();
    assert_eq!(
        within.text(),
        "a and b are equal: 3 rows, 6 fields\n  \
         x_m: within its tolerance, at most 5e-1 in row 3 (line 4)\n"
    );
}

#[test]
fn bytes_count_unless_something_may_differ() {
    let a = "x_m,y_m\n1,2\n";
    for b in [
        "y_m,x_m\n2,1\n",
        "# note\nx_m,y_m\n1,2\n",
        "x_m,y_m\r\n1,2\r\n",
        "x_m,y_m\n\"1\",2\n",
    ] {
        let text = said(a, b, &Rules::default());
        assert!(text.contains("the bytes are not"), "{b}: {text}");
        assert_eq!(said(a, b, &rules(&["*=0"], &[])), "", "{b}");
    }
    // A number's spelling is a difference of its own.
    let b = "x_m,y_m\n1.0,2\n";
    assert!(said(a, b, &Rules::default()).contains("x_m: 1 difference"));
    assert_eq!(said(a, b, &rules(&["*=0"], &[])), "");
}

#[test]
fn what_is_missing_is_equal_to_itself_only() {
    let any = rules(&["*=1e9"], &[]);
    for (a, b, equal) in [
        ("", "", true),
        ("nan", "nan", true),
        ("inf", "inf", true),
        ("", "0", false),
        ("nan", "0", false),
        ("nan", "", false),
        ("inf", "-inf", false),
        ("inf", "1", false),
        ("1 inf 3", "1.5 inf 2", true),
        ("1 2", "1 2 3", false),
        ("1 on 3", "2 off 3", false),
        ("1 on 3", "2 on 3", true),
    ] {
        let text = |field: &str| format!("stamp_ns,v\n1,{field}\n");
        let same = said(&text(a), &text(b), &any).is_empty();
        assert_eq!(same, equal, "{a:?} {b:?}");
    }
}

#[test]
fn stamps_lose_nothing() {
    let text = |ns: i64| format!("stamp_ns\n{ns}\n");
    let (a, b) = (
        text(1_700_000_000_000_000_000),
        text(1_700_000_000_000_000_001),
    );
    assert_eq!(said(&a, &b, &rules(&["stamp_ns=1"], &[])), "");
    let text = said(&a, &b, &rules(&["stamp_ns=0"], &[]));
    assert!(text.contains("the largest 1e0"), "{text}");
    let (a, b) = (
        format!("stamp_ns\n{}\n", i64::MIN),
        format!("stamp_ns\n{}\n", i64::MAX),
    );
    assert!(!said(&a, &b, &rules(&["stamp_ns=1"], &[])).is_empty());
}

#[test]
fn rows_and_columns_that_one_file_lacks() {
    let a = "n,x_m,more\n1,1,5\n2,2,5\n3,3,5\n";
    let b = "n,x_m,else,other\n1,1,5,5\n";
    let text = said(a, b, &Rules::default());
    for part in [
        "a and b differ; what both have is equal: 1 row, 2 fields\n",
        "  only in a: column more\n",
        "  only in b: columns else, other\n",
        "  only in a: 2 rows at the end, from row 2 on\n",
    ] {
        assert!(text.contains(part), "{part} {text}");
    }
    let text = said(b, a, &rules(&[], &["else", "other", "more"]));
    assert!(
        text.ends_with("\n  only in b: 2 rows at the end, from row 2 on\n"),
        "{text}"
    );
    assert!(
        said(a, "n,x_m,more\n1,1,5\n2,2,5\n", &Rules::default()).contains("row 3, the last one")
    );
}

#[test]
fn a_key_finds_rows_that_have_moved() {
    let a = "n,x_m\n1,1\n2,2\n3,3\n4,4\n";
    let b = "n,x_m\n5,5\n3,3\n1,1\n2,2.5\n";
    let mut found = tables(a, b, Some("n"), &Rules::default()).unwrap();
    let text = found.text();
    assert!(
        text.starts_with("a and b differ in 1 row of 3, 1 field\n"),
        "{text}"
    );
    assert!(text.contains("only in a: row with n 4") && text.contains("only in b: row with n 5"));
    assert!(
        text.contains("the first in the row with n 2: 2 and 2.5"),
        "{text}"
    );
    for (a, b, part) in [
        (a, "n,x_m\n1,1\n1,2\n", "b:3: n 1 is there twice"),
        ("x_m\n1\n", "n,x_m\n1,1\n", "a: there is no column n"),
    ] {
        let error = tables(a, b, Some("n"), &Rules::default())
            .unwrap_err()
            .to_string();
        assert!(error.starts_with(part), "{error}");
    }
}

#[test]
fn what_cannot_be_compared_is_said() {
    for (a, b, part) in [
        ("", "x\n", "a: empty"),
        ("x\n1\n", "y\n1\n", "no column in common"),
        ("x,x\n", "x\n", "a: column x is there twice"),
        (
            "x,y\n1,2\n1\n",
            "x,y\n1,2\n1,3\n",
            "a:3: 1 fields where the header has 2",
        ),
    ] {
        let error = tables(a, b, None, &Rules::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn a_rule_for_no_column_is_refused() {
    let (a, b) = ("stamp_ns,x_m\n1,2\n", "stamp_ns,y_m\n1,3\n");
    for (tolerances, ignored, unknown) in [
        (&["foo=1"][..], &[][..], Some("foo")),
        (&["*=0", "z_*=1"], &[], Some("z_*")),
        (&[], &["foo"], Some("foo")),
        (&["x_m=1", "*_m=1"], &["y_m", "x_m"], None),
    ] {
        let rules = rules(tolerances, ignored);
        match (tables(a, b, None, &rules), unknown) {
            (Ok(_), None) => {}
            (Err(DiffError::Unknown(text)), Some(name)) => assert!(
                text.contains(&format!(
                    "neither a nor b has a column {name}; there are stamp_ns"
                )),
                "{text}"
            ),
            other => panic!("{tolerances:?} {ignored:?}: {other:?}"),
        }
    }
    let text = b"{\"a\":{\"b\":1}}";
    let json = |rules: &Rules| tree::compare(text, text, ["a", "b"], rules);
    assert!(json(&rules(&["b=1"], &[])).is_ok());
    let refused = json(&rules(&["c=1"], &[])).unwrap_err().to_string();
    assert!(refused.ends_with("there are a.b"), "{refused}");
    let key = tables(a, b, Some("n"), &Rules::default());
    assert!(matches!(key, Err(DiffError::Unknown(_))), "{key:?}");
}

fn trees(a: &str, b: &str, rules: &Rules) -> String {
    let mut found = tree::compare(a.as_bytes(), b.as_bytes(), ["a", "b"], rules).unwrap();
    if found.is_equal() {
        String::new()
    } else {
        found.text()
    }
}

#[test]
fn values_of_json_have_paths() {
    let a = r#"{"runs":[{"x":{"rms_mm":1.0,"n":3},"notes":[]}],"version":"1"}"#;
    let b = r#"{"runs":[{"x":{"rms_mm":1.5,"n":3},"notes":["odd"]}],"version":"2"}"#;
    let text = trees(a, b, &Rules::default());
    assert!(
        text.contains("  runs.0.x.rms_mm: 1.0 and 1.5; the largest 5e-1\n"),
        "{text}"
    );
    assert!(
        text.contains("only in b: runs.0.notes.0, \"odd\""),
        "{text}"
    );
    assert!(text.contains("version: \"\\\"1\\\"\" and"), "{text}");
    assert_eq!(
        trees(a, b, &rules(&["rms_mm=0.5"], &["version", "*.notes*"])),
        ""
    );
    assert!(trees("{\"a\":1}", "{ \"a\": 1 }", &Rules::default()).contains("the bytes are not"));
    assert_eq!(
        trees("{\"a\":1}", "{ \"a\": 1 }", &rules(&["*=0"], &[])),
        ""
    );
    assert!(tree::compare(b"{", b"{}", ["a", "b"], &Rules::default()).is_err());
}

#[test]
fn records_are_compared_by_their_columns() {
    let point = |x: f64| TrajectoryPoint {
        stamp: Stamp::from_ns(5),
        position_m: [x, 0.0, f64::NAN],
        ..TrajectoryPoint::default()
    };
    let mut found = Comparison::new(["a", "b"], &rules(&["x_m=1e-3"], &[]));
    let columns = found.columns_of::<TrajectoryPoint>("/truth");
    found.check_rules().unwrap();
    let mut compare = |place: &str, b: f64| {
        found.records(&columns, &|| place.to_owned(), &point(1.0), &point(b));
        found.is_equal()
    };
    assert!(compare("1", 1.0005) && !compare("2", 1.5));
    let text = found.text();
    assert!(
        text.contains("/truth.x_m: 1 difference, the first in 2: 1 and 1.5"),
        "{text}"
    );
}

proptest! {
    #[test]
    fn any_text_is_compared_or_refused(a in "\\PC{0,40}|[xy,0-9.\n\"#]{0,60}", b in "[xy,0-9.\n\"#]{0,60}") {
        for key in [None, Some("x")] {
            if let Ok(mut found) = tables(&a, &b, key, &rules(&["*=1"], &[])) {
                let _ = found.text();
            }
            let _ = tree::compare(a.as_bytes(), b.as_bytes(), ["a", "b"], &Rules::default());
        }
    }

    #[test]
    fn every_text_is_equal_to_itself(a in "[xy,0-9.\n\"#]{0,60}") {
        if let Ok(found) = tables(&a, &a, None, &Rules::default()) {
            prop_assert!(found.is_equal());
        }
    }
}
