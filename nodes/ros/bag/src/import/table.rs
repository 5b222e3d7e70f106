//! Rows of a track in CSV.

use crate::error::BagError;
use catenary_core::GripPose;
use csv::{ReaderBuilder, StringRecord, Trim};

/// Columns of every track.
pub(super) const COLUMNS: [&str; 12] = [
    "t_s",
    "grip_x_m",
    "grip_z_m",
    "grip_pitch_rad",
    "p1_x_m",
    "p1_z_m",
    "p2_x_m",
    "p2_z_m",
    "p3_x_m",
    "p3_z_m",
    "p4_x_m",
    "p4_z_m",
];
/// Columns of the wrench: all or none of them.
const WRENCH: [&str; 3] = ["grip_fx_n", "grip_fz_n", "grip_ty_nm"];
/// Longest track in s: 11 days, far below the 68 years that stamps of messages hold.
const LONGEST_S: f64 = 1e6;
/// Most rows of a track: an hour at 1 kHz would have 3.6 million. They bound the memory that a damaged file can claim.
const MOST_ROWS: usize = 10_000_000;
/// Greatest coordinate, m. It is far from any cell, and leaves points in millimetres to the check of units, which explains them.
const FARTHEST_M: f64 = 1e5;
/// Greatest force in N, and torque in N m: a thousand times what a Panda bears.
const GREATEST_WRENCH: f64 = 1e5;

/// Row of a track: the state at one time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row {
    /// Line in the file, from 1.
    pub(super) line: u64,
    /// Time since the first row, ns.
    pub(super) time_ns: i64,
    /// Pose of the clamped end.
    pub(super) grip: GripPose,
    /// Four points (x, z) of the object in m.
    pub(super) points_m: [[f64; 2]; 4],
    /// Force along x and z in N, and torque about y in N m, at the grip.
    pub(super) wrench: Option<[f64; 3]>,
}

impl Row {
    /// Time since the first row in s.
    pub(super) fn time_s(&self) -> f64 {
        self.time_ns as f64 * 1e-9
    }
}

struct Table<'a> {
    file: &'a str,
    header: Vec<String>,
}

impl Table<'_> {
    fn error(&self, line: u64, column: &str, expected: impl Into<String>, got: impl Into<String>) -> BagError {
        let (file, column) = (self.file.to_owned(), column.to_owned());
        BagError::Csv { file, line, column, expected: expected.into(), got: got.into() }
    }

    /// Checks the columns. Returns true if the track has a wrench.
    fn check_header(&self) -> Result<bool, BagError> {
        for (i, name) in self.header.iter().enumerate() {
            if !COLUMNS.contains(&name.as_str()) && !WRENCH.contains(&name.as_str()) {
                let expected = format!("one of {}, {}", COLUMNS.join(", "), WRENCH.join(", "));
                return Err(self.error(1, &(i + 1).to_string(), expected, format!("{name:?}")));
            }
            if self.header[..i].contains(name) {
                return Err(self.error(1, name, "each column once", "it twice"));
            }
        }
        let missing = |names: &[&'static str]| names.iter().find(|n| !self.header.iter().any(|h| h == *n)).copied();
        if let Some(name) = missing(&COLUMNS) {
            return Err(self.error(1, name, "this column", format!("the columns {}", self.header.join(", "))));
        }
        match (missing(&WRENCH), WRENCH.iter().any(|n| self.header.iter().any(|h| h == n))) {
            (Some(name), true) => Err(self.error(1, name, "all columns of the wrench, or none", "a part of them")),
            (missing, _) => Ok(missing.is_none()),
        }
    }

    fn number(&self, line: u64, record: &StringRecord, column: &str) -> Result<f64, BagError> {
        let place = self.header.iter().position(|h| h == column);
        let text = place.and_then(|i| record.get(i)).unwrap_or_default();
        let number = text.parse::<f64>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| self.error(line, column, "a finite number", format!("{text:?}")))
    }

    fn numbers<const N: usize>(
        &self,
        line: u64,
        record: &StringRecord,
        columns: [&str; N],
    ) -> Result<[f64; N], BagError> {
        let mut out = [0.0; N];
        for (value, column) in out.iter_mut().zip(columns) {
            *value = self.number(line, record, column)?;
        }
        Ok(out)
    }
}

impl Table<'_> {
    /// Numbers of at most `greatest`, in `unit`, on either side of zero.
    fn within<const N: usize>(
        &self,
        line: u64,
        record: &StringRecord,
        columns: [&str; N],
        greatest: f64,
        unit: &str,
    ) -> Result<[f64; N], BagError> {
        let numbers = self.numbers(line, record, columns)?;
        match columns.into_iter().zip(numbers).find(|(_, v)| v.abs() > greatest) {
            Some((column, got)) => {
                Err(self.error(line, column, format!("a number of -{greatest} to {greatest} {unit}"), got.to_string()))
            }
            None => Ok(numbers),
        }
    }
}

/// Reads the rows of a track. `file` is the name of the track in messages.
pub(super) fn read_rows(file: &str, csv: &str) -> Result<Vec<Row>, BagError> {
    if csv.trim().is_empty() {
        let (file, column) = (file.to_owned(), COLUMNS[0].to_owned());
        let (expected, got) = ("a header line and rows of numbers".to_owned(), "an empty file".to_owned());
        return Err(BagError::Csv { file, line: 1, column, expected, got });
    }
    // The reader counts the lines of a file with CRLF one too low.
    let csv = csv.replace("\r\n", "\n");
    // A flexible reader passes rows of a wrong length on; the check below names their line.
    let mut reader = ReaderBuilder::new().flexible(true).trim(Trim::All).from_reader(csv.as_bytes());
    let header = reader.headers().map(|h| h.iter().map(str::to_owned).collect()).unwrap_or_default();
    let table = Table { file, header };
    let has_wrench = table.check_header()?;
    let mut rows: Vec<Row> = Vec::new();
    let mut first_s = 0.0;
    for record in reader.records() {
        let record = record.map_err(|e| {
            let line = e.position().map_or(0, csv::Position::line);
            table.error(line, "any", "a line of CSV", e.to_string())
        })?;
        let line = record.position().map_or(0, csv::Position::line);
        if record.len() != table.header.len() {
            let expected = format!("{} values, as in the header", table.header.len());
            return Err(table.error(line, "the last", expected, record.len().to_string()));
        }
        let time_s = table.number(line, &record, "t_s")?;
        if rows.is_empty() {
            first_s = time_s;
        }
        if time_s - first_s > LONGEST_S {
            let expected = format!("times in s, at most {LONGEST_S} s after the first row");
            return Err(table.error(line, "t_s", expected, time_s.to_string()));
        }
        let time_ns = ((time_s - first_s) * 1e9).round() as i64;
        // Compared in ns, because stamps are: two times within a nanosecond would get one stamp.
        if rows.last().is_some_and(|r| time_ns <= r.time_ns) {
            return Err(table.error(line, "t_s", "a later time than in the row before", time_s.to_string()));
        }
        if rows.len() == MOST_ROWS {
            return Err(table.error(line, "any", format!("at most {MOST_ROWS} rows"), "more"));
        }
        let [x_m, z_m] = table.within(line, &record, ["grip_x_m", "grip_z_m"], FARTHEST_M, "m")?;
        let [pitch_rad] = table.numbers(line, &record, ["grip_pitch_rad"])?;
        if pitch_rad.abs() > std::f64::consts::TAU {
            let expected = "an angle in rad, at most 2 pi from zero";
            return Err(table.error(line, "grip_pitch_rad", expected, format!("{pitch_rad}, as if in degrees")));
        }
        let p: [f64; 8] = table.within(line, &record, std::array::from_fn(|i| COLUMNS[4 + i]), FARTHEST_M, "m")?;
        rows.push(Row {
            line,
            time_ns,
            grip: GripPose { x_m, z_m, pitch_rad },
            points_m: std::array::from_fn(|i| [p[2 * i], p[2 * i + 1]]),
            wrench: if has_wrench {
                Some(table.within(line, &record, WRENCH, GREATEST_WRENCH, "N or N m")?)
            } else {
                None
            },
        });
    }
    if rows.len() < 2 {
        return Err(table.error(1 + rows.len() as u64, "t_s", "at least two rows", rows.len().to_string()));
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header() -> String {
        COLUMNS.join(",")
    }

    fn row(t: &str) -> String {
        format!("{t},0.1,0.7,0.01,1,2,3,4,5,6,7,8")
    }

    fn error(csv: &str) -> String {
        read_rows("track.csv", csv).unwrap_err().to_string()
    }

    #[test]
    fn lines_are_counted_alike_with_every_line_end_and_degrees_are_no_radians() {
        let csv = format!("{}\n{}\n{}\n", header(), row("0.0"), row("0.1").replace(",8", ",nan"));
        for csv in [csv.clone(), csv.replace('\n', "\r\n")] {
            assert!(error(&csv).starts_with("track.csv: line 3, column p4_z_m"), "{}", error(&csv));
        }
        let degrees = csv.replace("0.01,1", "-90,1");
        assert_eq!(
            error(&degrees),
            "track.csv: line 2, column grip_pitch_rad: expected an angle in rad, at most 2 pi from zero, got -90, as if in degrees"
        );
    }

    #[test]
    fn columns_may_come_in_any_order() {
        let csv = format!(
            "grip_ty_nm,grip_fx_n,{},grip_fz_n\n0.3,0.1,{},0.2\n0.3,0.1,{},0.2\n",
            header(),
            row("2.5"),
            row(" 2.75 ")
        );
        let rows = read_rows("track.csv", &csv).unwrap();
        assert_eq!(rows.len(), 2);
        assert_eq!((rows[1].line, rows[0].time_ns, rows[1].time_ns), (3, 0, 250_000_000));
        assert_eq!(rows[0].points_m, [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]]);
        assert_eq!(rows[0].wrench, Some([0.1, 0.2, 0.3]));
        assert_eq!(rows[0].grip, GripPose { x_m: 0.1, z_m: 0.7, pitch_rad: 0.01 });
    }

    #[test]
    fn errors_name_file_line_column_and_value() {
        let good = format!("{}\n{}\n{}\n", header(), row("0.0"), row("0.1"));
        read_rows("track.csv", &good).unwrap();
        let expected = [
            (
                good.replace("0.7,0.01", "0.7,steep"),
                "track.csv: line 2, column grip_pitch_rad: expected a finite number",
            ),
            (good.replace("0.7,0.01", "0.7,steep"), "\"steep\""),
            (good.replacen(",7,8\n", ",7,nan\n", 1), "line 2, column p4_z_m"),
            (good.replace("\n0.1,", "\n0.0,"), "line 3, column t_s: expected a later time"),
            (good.replace(",7,8\n", ",7\n"), "line 2, column the last: expected 12 values, as in the header, got 11"),
            (good.replace("p3_z_m", "p3_y_m"), "\"p3_y_m\""),
            (good.replace("p3_z_m", "p3_x_m"), "column p3_x_m: expected each column once"),
            (good.replace(",p4_z_m", ""), "line 1, column p4_z_m: expected this column"),
            (good.replace(",p4_z_m\n", ",p4_z_m,grip_fx_n\n"), "column grip_fz_n: expected all columns of the wrench"),
            (format!("{}\n{}\n", header(), row("0.0")), "expected at least two rows, got 1"),
            (good.replace("\n0.1,", "\n1e300,"), "column t_s: expected times in s, at most"),
            (
                good.replacen("0.1,0.7", "0.1,1e300", 1),
                "line 2, column grip_z_m: expected a number of -100000 to 100000 m",
            ),
            (
                good.replacen(",7,8\n", ",7,-1e9\n", 1),
                "line 2, column p4_z_m: expected a number of -100000 to 100000 m",
            ),
            (" \n".to_owned(), "line 1, column t_s: expected a header line and rows of numbers, got an empty file"),
        ];
        for (csv, part) in expected {
            let e = error(&csv);
            assert!(e.contains(part), "{part}: {e}");
        }
    }
}
