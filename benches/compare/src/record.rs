//! Rows and tables on their way to the terminal, to CSV and to the record.

use std::fmt::Write as _;
use std::path::PathBuf;

/// The first line of the CSV of rows.
pub const COLUMNS: &str = "row,access,ours_ns,baseline,baseline_ns,goal_ns,max_error";

/// One comparison.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// Name of the lookup.
    pub row: String,
    /// The order of the queries, or the meaning of numbers that are not times.
    pub access: String,
    /// Nanoseconds of one lookup.
    pub ours: Option<f64>,
    /// What it is compared with, or why the row was skipped.
    pub baseline: String,
    /// Nanoseconds of the baseline.
    pub theirs: Option<f64>,
    /// Nanoseconds that are aimed at.
    pub goal: Option<f64>,
    /// The largest error that was found before the clock ran.
    pub error: Option<f64>,
}

impl Row {
    /// A row with a name.
    pub fn new(row: impl Into<String>, access: impl Into<String>) -> Self {
        Row {
            row: row.into(),
            access: access.into(),
            ..Row::default()
        }
    }

    /// With both times.
    pub fn times(mut self, ours: f64, baseline: impl Into<String>, theirs: f64) -> Self {
        self.ours = Some(ours);
        self.theirs = Some(theirs);
        self.baseline = baseline.into();
        self
    }

    /// With a goal.
    pub fn goal(mut self, goal: f64) -> Self {
        self.goal = Some(goal);
        self
    }

    /// With a largest error.
    pub fn error(mut self, error: f64) -> Self {
        self.error = Some(error);
        self
    }

    /// That could not run.
    pub fn skipped(mut self, why: impl AsRef<str>) -> Self {
        self.baseline = format!("skipped: {}", why.as_ref());
        self
    }

    /// The row as a line of CSV.
    fn csv(&self) -> String {
        let quoted = |field: &String| match field.contains(',') {
            true => format!("\"{field}\""),
            false => field.clone(),
        };
        self.fields().each_ref().map(quoted).join(",")
    }

    fn fields(&self) -> [String; 7] {
        let number = |x: Option<f64>| match x {
            None => String::new(),
            Some(x) if x >= 1000.0 => format!("{x:.0}"),
            Some(x) => format!("{x:.1}"),
        };
        let error = self.error.map_or(String::new(), |e| format!("{e:.2e}"));
        let text = |s: &str| s.replace('|', "/");
        let (ours, theirs, goal) = (number(self.ours), number(self.theirs), number(self.goal));
        let (row, access) = (text(&self.row), text(&self.access));
        [row, access, ours, text(&self.baseline), theirs, goal, error]
    }
}

/// All that a run found.
#[derive(Debug, Default)]
pub struct Record {
    rows: Vec<Row>,
    /// Rows that are in the text.
    told: usize,
    text: String,
    /// Where CSV, plots and the record go; nowhere in a quick run.
    pub folder: Option<PathBuf>,
    /// Whether rows are printed as CSV as soon as they are there.
    pub csv: bool,
}

impl Record {
    /// Adds a row.
    pub fn row(&mut self, row: Row) {
        if self.csv {
            println!("{}", row.csv());
        } else {
            eprintln!("{}", row.fields().join(" | "));
        }
        self.rows.push(row);
    }

    /// Adds a paragraph to the record.
    pub fn say(&mut self, text: impl AsRef<str>) {
        let _ = writeln!(self.text, "{}\n", text.as_ref());
    }

    /// Adds a heading to the record.
    pub fn heading(&mut self, text: &str) {
        self.say(format!("## {text}"));
    }

    /// Adds a table to the record, and writes it as `compare-NAME.csv`.
    pub fn table(&mut self, name: &str, columns: &[&str], lines: &[Vec<String>]) {
        let mut out = format!(
            "| {} |\n|{}\n",
            columns.join(" | "),
            "---|".repeat(columns.len())
        );
        let mut csv = columns.join(",") + "\n";
        for line in lines {
            let _ = writeln!(out, "| {} |", line.join(" | "));
            let _ = writeln!(csv, "{}", line.join(","));
        }
        self.say(out.trim_end());
        self.write(&format!("compare-{name}.csv"), &csv);
    }

    /// Adds the rows since the last call as a table of the record.
    pub fn flush_rows(&mut self) {
        let ratio = |r: &Row| match (r.ours, r.theirs) {
            (Some(a), Some(b)) => format!("{:.2}", a / b),
            _ => String::new(),
        };
        let mut out = String::from(
            "| row | access | ours | baseline | its | ours / its | goal | largest error \
             |\n|---|---|---|---|---|---|---|---|\n",
        );
        for r in &self.rows[self.told..] {
            let [row, access, ours, baseline, theirs, goal, error] = r.fields();
            let _ = writeln!(
                out,
                "| {row} | {access} | {ours} | {baseline} | {theirs} | {} | {goal} | {error} |",
                ratio(r)
            );
        }
        self.told = self.rows.len();
        self.say(out.trim_end());
    }

    /// Writes a file into the folder of records, if there is one.
    pub fn write(&self, name: &str, text: &str) {
        if let Some(folder) = &self.folder {
            std::fs::create_dir_all(folder).expect("the folder of records");
            std::fs::write(folder.join(name), text).expect("a record");
        }
    }

    /// Writes `compare.csv` and `compare.md`, and prints the record unless it was printed as CSV.
    pub fn finish(self) {
        let lines: Vec<String> = self.rows.iter().map(Row::csv).collect();
        self.write("compare.csv", &format!("{COLUMNS}\n{}\n", lines.join("\n")));
        self.write("compare.md", &self.text);
        if !self.csv {
            print!("{}", self.text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_seven_fields_whatever_its_words() {
        let row = Row::new("a, b", "random").skipped("none, alas").goal(20.0);
        assert_eq!(row.csv(), "\"a, b\",random,,\"skipped: none, alas\",,20.0,");
    }
}
