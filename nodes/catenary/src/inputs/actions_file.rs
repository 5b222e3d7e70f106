//! Actions of an episode as a CSV file.

use catenary_bag::BagError;
use catenary_core::task::{MAX_DELTA_M, MOST_STEPS};
use csv::{Position, ReaderBuilder, StringRecord, Trim};

/// Columns of the file.
const COLUMNS: [&str; 2] = ["dx_m", "dz_m"];

/// Reads actions (dx, dz) in m from a text with a header and the columns `dx_m` and `dz_m`. Error messages call the
/// text `file`.
///
/// # Errors
/// [`BagError::Csv`] names line and column.
pub fn read(file: &str, csv: &str) -> Result<Vec<[f64; 2]>, BagError> {
    let error = |line: u64, column: &str, expected: String, got: String| BagError::Csv {
        file: file.to_owned(),
        line,
        column: column.to_owned(),
        expected,
        got,
    };
    let mut reader = ReaderBuilder::new().flexible(true).trim(Trim::All).from_reader(csv.as_bytes());
    let header: Vec<String> = reader.headers().map(|h| h.iter().map(str::to_owned).collect()).unwrap_or_default();
    if let Some((i, name)) =
        header.iter().enumerate().find(|(i, h)| !COLUMNS.contains(&h.as_str()) || header[..*i].contains(h))
    {
        return Err(error(
            1,
            &(i + 1).to_string(),
            format!("the columns {}, each once", COLUMNS.join(", ")),
            format!("{name:?}"),
        ));
    }
    if let Some(name) = COLUMNS.iter().find(|c| !header.iter().any(|h| h == *c)) {
        return Err(error(1, name, "this column in the header".into(), format!("the columns {}", header.join(", "))));
    }
    let number = |line: u64, record: &StringRecord, column: &str| {
        let text = header.iter().position(|h| h == column).and_then(|i| record.get(i)).unwrap_or_default();
        // The limit of the policy's actions; NaN fails the comparison, too.
        let value = text.parse::<f64>().ok().filter(|v| v.abs() <= MAX_DELTA_M);
        value.ok_or_else(|| {
            error(line, column, format!("a number within -{MAX_DELTA_M} and {MAX_DELTA_M} m"), format!("{text:?}"))
        })
    };
    let mut actions = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| {
            let line = e.position().map_or(0, Position::line);
            error(line, "any", "a line of CSV".into(), e.to_string())
        })?;
        let line = record.position().map_or(0, Position::line);
        if record.len() != COLUMNS.len() {
            return Err(error(
                line,
                "the last",
                format!("{} values, as in the header", COLUMNS.len()),
                record.len().to_string(),
            ));
        }
        if actions.len() == MOST_STEPS {
            return Err(error(line, "any", format!("at most {MOST_STEPS} actions"), "more".into()));
        }
        actions.push([number(line, &record, COLUMNS[0])?, number(line, &record, COLUMNS[1])?]);
    }
    if actions.is_empty() {
        return Err(error(2, COLUMNS[0], "at least one action".into(), "none".into()));
    }
    Ok(actions)
}

/// Actions in the form that [`read`] reads.
pub fn written(actions: &[[f64; 2]]) -> String {
    let rows = actions.iter().map(|[dx, dz]| format!("{dx},{dz}\n"));
    std::iter::once(format!("{}\n", COLUMNS.join(","))).chain(rows).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_may_come_in_any_order() {
        assert_eq!(read("a.csv", "dz_m,dx_m\n -0.01 , 0.06\n0,0\n").unwrap(), [[0.06, -0.01], [0.0, 0.0]]);
    }

    #[test]
    fn a_file_of_more_actions_than_an_episode_has_is_refused() {
        let long = |rows| format!("dx_m,dz_m\n{}", "0,0\n".repeat(rows));
        assert_eq!(read("a.csv", &long(MOST_STEPS)).unwrap().len(), MOST_STEPS);
        let error = read("a.csv", &long(MOST_STEPS + 1)).unwrap_err().to_string();
        assert_eq!(error, "a.csv: line 100002, column any: expected at most 100000 actions, got more");
    }

    #[test]
    fn errors_name_file_line_column_and_value() {
        let expected = [
            ("", "a.csv: line 1, column dx_m: expected this column in the header"),
            ("0.01,0.02\n", "a.csv: line 1, column 1: expected the columns dx_m, dz_m, each once, got \"0.01\""),
            ("dx_m\n0.1\n", "line 1, column dz_m: expected this column in the header, got the columns dx_m"),
            ("dx_m,dx_m\n", "line 1, column 2: "),
            ("dx_m,dz_m\n", "line 2, column dx_m: expected at least one action, got none"),
            ("dx_m,dz_m\n0,0\n0.01,up\n", "line 3, column dz_m: expected a number within -0.06 and 0.06 m, got \"up\""),
            ("dx_m,dz_m\n0,0.061\n", "line 2, column dz_m: expected a number within"),
            ("dx_m,dz_m\nnan,0\n", "line 2, column dx_m: "),
            ("dx_m,dz_m\n0.01\n", "line 2, column the last: expected 2 values, as in the header, got 1"),
        ];
        for (csv, part) in expected {
            let e = read("a.csv", csv).unwrap_err().to_string();
            assert!(e.contains(part), "{part}: {e}");
        }
    }
}
