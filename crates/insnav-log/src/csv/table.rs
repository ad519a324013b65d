//! A table of numbers with named columns.

use crate::error::LogError;
use flate2::read::MultiGzDecoder;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// A table of numbers, by columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    path: PathBuf,
    header: Vec<String>,
    columns: Vec<Vec<f64>>,
    /// Line of each row in the file, from 1.
    lines: Vec<usize>,
}

impl Table {
    /// Read a comma-separated table whose first line names the columns; gzip is recognised by its first bytes.
    ///
    /// Lines that are blank or begin with `#` are skipped. A cell that is empty or `nan` is NaN; anything else that is no
    /// number, and a line with too many or too few cells, is an error with its line and column.
    pub fn read(path: &Path) -> Result<Self, LogError> {
        let mut lines = open_text(path)?;
        let mut line = String::new();
        let mut number = 0;
        let mut table = Table {
            path: path.into(),
            header: Vec::new(),
            columns: Vec::new(),
            lines: Vec::new(),
        };
        while read_line(&mut *lines, &mut line, path)? {
            number += 1;
            let text = line.trim();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            if table.header.is_empty() {
                table.header = text
                    .trim_start_matches('\u{feff}')
                    .split(',')
                    .map(|name| name.trim().to_owned())
                    .collect();
                table.columns = vec![Vec::new(); table.header.len()];
            } else {
                table.push(text, number)?;
                table.lines.push(number);
            }
        }
        Ok(table)
    }

    fn push(&mut self, text: &str, line: usize) -> Result<(), LogError> {
        let bad = |column: &str, reason: String| LogError::Cell {
            path: self.path.clone(),
            line,
            column: column.into(),
            reason,
        };
        let mut cells = text.split(',');
        let header = &self.header;
        for (name, column) in header.iter().zip(&mut self.columns) {
            let Some(cell) = cells.next() else {
                return Err(bad(
                    name,
                    format!(
                        "the line ends before this column, {} are named",
                        header.len()
                    ),
                ));
            };
            let cell = cell.trim();
            let value = if cell.is_empty() {
                Ok(f64::NAN)
            } else {
                cell.parse()
            };
            column.push(value.map_err(|_| bad(name, format!("{cell:?} is no number")))?);
        }
        match cells.next() {
            Some(extra) => Err(bad(
                extra.trim(),
                format!("a cell beyond the {} named columns", header.len()),
            )),
            None => Ok(()),
        }
    }

    /// Names of the columns.
    pub fn header(&self) -> &[String] {
        &self.header
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    /// A column by the first of these names that is there.
    pub fn column(&self, names: &[&str]) -> Option<&[f64]> {
        names
            .iter()
            .find_map(|name| self.header.iter().position(|known| known == name))
            .map(|index| self.columns[index].as_slice())
    }

    /// As [`Table::column`], or the error that names the file and the column.
    pub fn require(&self, names: &[&str]) -> Result<&[f64], LogError> {
        self.column(names).ok_or_else(|| LogError::MissingColumn {
            path: self.path.clone(),
            missing: names.iter().map(|name| (*name).to_owned()).collect(),
            header: self.header.join(","),
        })
    }

    /// A column by name, or one of NaN.
    pub(super) fn column_or_nan(&self, names: &[&str]) -> Vec<f64> {
        self.column(names)
            .map_or_else(|| vec![f64::NAN; self.rows()], <[f64]>::to_vec)
    }

    /// Columns that may be missing, but only all together.
    pub(super) fn group(&self, names: &[&[&str]]) -> Result<bool, LogError> {
        let present = names
            .iter()
            .filter(|names| self.column(names).is_some())
            .count();
        if present == 0 {
            return Ok(false);
        }
        for names in names {
            self.require(names)?;
        }
        Ok(true)
    }

    /// Times in the column `t_s`, finite.
    pub(super) fn times(&self) -> Result<Vec<f64>, LogError> {
        let times = self.require(&["t_s"])?;
        match times.iter().position(|t| !t.is_finite()) {
            None => Ok(times.to_vec()),
            Some(row) => Err(LogError::Cell {
                path: self.path.clone(),
                line: self.lines[row],
                column: "t_s".into(),
                reason: "a row without a time".into(),
            }),
        }
    }
}

/// Lines of a file, unpacked if it is gzip.
pub(crate) fn open_text(path: &Path) -> Result<Box<dyn BufRead>, LogError> {
    let file = File::open(path).map_err(|e| LogError::opening(path, e))?;
    let mut reader = BufReader::with_capacity(1 << 16, file);
    let zipped = reader
        .fill_buf()
        .map_err(|e| LogError::opening(path, e))?
        .starts_with(&[0x1f, 0x8b]);
    let unpacked: Box<dyn Read> = if zipped {
        Box::new(MultiGzDecoder::new(reader))
    } else {
        Box::new(reader)
    };
    Ok(Box::new(BufReader::with_capacity(1 << 16, unpacked)))
}

/// The next line, or `false` at the end.
pub(crate) fn read_line(
    from: &mut dyn BufRead,
    line: &mut String,
    path: &Path,
) -> Result<bool, LogError> {
    line.clear();
    let length = from
        .read_line(line)
        .map_err(|e| LogError::opening(path, e))?;
    Ok(length > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn table(text: &str) -> Result<Table, LogError> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        Table::read(file.path())
    }

    #[test]
    fn columns_are_known_by_their_names() {
        let table = table("# a comment\nt_s, b ,a\r\n0.5,nan,\n1e0,2,-3\n\n").unwrap();
        assert_eq!(
            (table.rows(), table.header().join("|")),
            (2, "t_s|b|a".to_owned())
        );
        assert_eq!(table.column(&["t_s"]).unwrap(), [0.5, 1.0]);
        assert!(table.column(&["a"]).unwrap()[0].is_nan());
        assert_eq!(table.column(&["x", "b"]).unwrap()[1], 2.0);
        let error = table.require(&["lat_deg"]).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("no column lat_deg; the header is \"t_s,b,a\""),
            "{error}"
        );
    }

    #[test]
    fn a_bad_cell_is_named_by_line_and_column() {
        for (text, place) in [
            ("t_s,a\n0,1\n1,x\n", ":3: column \"a\""),
            ("t_s,a\n0\n", ":2: column \"a\""),
        ] {
            let error = table(text).unwrap_err();
            assert_eq!(error.code(), "bad_cell");
            assert!(error.to_string().contains(place), "{error}");
        }
        assert!(table("t_s,a\n0,1,2\n").is_err());
        let error = table("# made by hand\nt_s,a\n0,1\n\nnan,2\n")
            .unwrap()
            .times()
            .unwrap_err();
        assert!(
            error
                .to_string()
                .contains(":5: column \"t_s\": a row without a time"),
            "{error}"
        );
    }
}
