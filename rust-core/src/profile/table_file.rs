//! Tables as files: CSV, and NumPy's npz.
//!
//! Two columns, or two arrays, with names: `angle` (degrees from the normal) or `slope` (their tangent), and `D`, `D_cos` (D cos θ), `slope_density`
//! (D cos⁴ θ; `density` too) or `value` (what it is, is said elsewhere); a plural `s` is allowed, and other columns of a CSV are not read. A CSV
//! without a line of names has two, angles first. What they do not say may be said by lines `# knee: 0.3`, `# tail: cut`, `# tail_exponent: 4` of a CSV, and by arrays of one number `knee`,
//! `tail_exponent` and `tail_cut` (true or false) of an npz.

use crate::error::ParameterError;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// What a file says.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TableFile {
    /// Are the places angles in degrees?
    pub by_angles: bool,
    /// Angles or slopes.
    pub places: Vec<f64>,
    /// Values there.
    pub values: Vec<f64>,
    /// What they are, if the file says so: D, `D_cos` or slope.
    pub quantity: Option<&'static str>,
    /// Does it end with the last row, or go on as a power?
    pub cut: Option<bool>,
    /// The exponent of that power.
    pub tail_exponent: Option<f64>,
    /// The knee of the interpolation, a slope.
    pub knee: Option<f64>,
}

/// No file of 1000 rows is greater.
const GREATEST: u64 = 1 << 24;

/// What a column holds.
enum Column {
    Angle,
    Slope,
    Value(Option<&'static str>),
}

impl Column {
    fn named(name: &str) -> Option<Self> {
        let name = name.trim().to_lowercase().replace(['-', ' '], "_");
        match name.strip_suffix('s').filter(|_| name != "d_cos").unwrap_or(&name) {
            "angle" => Some(Self::Angle),
            "slope" => Some(Self::Slope),
            "d" => Some(Self::Value(Some("D"))),
            "d_cos" => Some(Self::Value(Some("D_cos"))),
            "slope_density" | "slope_densitie" | "density" => Some(Self::Value(Some("slope"))),
            "value" => Some(Self::Value(None)),
            _ => None,
        }
    }
}

/// Reads a file, by the ending of its name: .npz, or else CSV.
///
/// # Errors
/// Names the file, the line and what is wrong with it.
pub fn read(path: &str) -> Result<TableFile, ParameterError> {
    let fail = |problem: String, mend: &'static str| ParameterError::File { path: path.to_owned(), problem, mend };
    let file = File::open(path).map_err(|error| fail(format!("cannot be read ({error})"), "check \"filename\""))?;
    let is_npz = Path::new(path).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npz"));
    let table = if is_npz { read_npz(file) } else { read_csv(file) };
    let table = table.map_err(|(problem, mend)| fail(problem, mend))?;
    if table.places.is_empty() {
        return Err(fail("has no rows of numbers".to_owned(), NAMES));
    }
    Ok(table)
}

type Problem = (String, &'static str);

const NAMES: &str =
    "give two columns, named angle or slope, and D, D_cos, slope_density or value; without names, angles come first";
const NUMBERS: &str = "each row is two numbers, separated by a comma, or as many as the first line has names";
const SAID: &str = "lines that begin with # may say knee, tail and tail_exponent";

fn read_csv(file: File) -> Result<TableFile, Problem> {
    let mut text = String::new();
    file.take(GREATEST)
        .read_to_string(&mut text)
        .map_err(|error| (format!("is no text ({error})"), "tables are .csv or .npz files"))?;
    let mut table = TableFile { by_angles: true, ..TableFile::default() };
    for (k, line) in text.lines().enumerate() {
        let Some((name, value)) = line.strip_prefix('#').and_then(|line| line.split_once(':')) else { continue };
        let number = || {
            let problem = || (format!("line {} is \"{line}\", but must be a number", k + 1), SAID);
            value.trim().parse::<f64>().map_err(|_| problem())
        };
        match name.trim() {
            "knee" => table.knee = Some(number()?),
            "tail_exponent" => table.tail_exponent = Some(number()?),
            "tail" => {
                table.cut = Some(match value.trim() {
                    "cut" => true,
                    "power" => false,
                    other => return Err((format!("line {} has a tail \"{other}\"", k + 1), "it is power or cut")),
                });
            }
            _ => {}
        }
    }
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    // where the places and the values are, and how many columns there are
    let (mut columns, mut count) = ([0, 1], 2);
    for (k, record) in reader.records().enumerate() {
        let record = record.map_err(|error| (format!("cannot be read as CSV ({error})"), NUMBERS))?;
        let line = record.position().map_or(0, csv::Position::line);
        if k == 0 && record.iter().all(|text| text.parse::<f64>().is_err()) {
            let place =
                record.iter().position(|name| matches!(Column::named(name), Some(Column::Angle | Column::Slope)));
            let value = record.iter().position(|name| matches!(Column::named(name), Some(Column::Value(_))));
            let (Some(place), Some(value)) = (place, value) else {
                let names = record.iter().collect::<Vec<_>>().join(", ");
                return Err((format!("line {line} names the columns {names}"), NAMES));
            };
            name_columns(&mut table, &record[place], &record[value]);
            (columns, count) = ([place, value], record.len());
            continue;
        }
        if record.len() != count {
            return Err((format!("line {line} has {} columns, but must have {count}", record.len()), NUMBERS));
        }
        let [place, value] = columns.map(|column| record[column].parse::<f64>().map_err(|_| &record[column]));
        match (place, value) {
            (Ok(place), Ok(value)) => {
                table.places.push(place);
                table.values.push(value);
            }
            (Err(bad), _) | (_, Err(bad)) => {
                return Err((format!("line {line} has \"{bad}\", which is not a number"), NUMBERS));
            }
        }
    }
    Ok(table)
}

fn name_columns(table: &mut TableFile, place: &str, value: &str) {
    table.by_angles = matches!(Column::named(place), Some(Column::Angle));
    if let Some(Column::Value(quantity)) = Column::named(value) {
        table.quantity = quantity;
    }
}

fn read_npz(file: File) -> Result<TableFile, Problem> {
    const ARRAYS: &str =
        "save it with numpy.savez: an array named angles or slopes, and one named D, D_cos, slope_density or values";
    let mut archive = zip::ZipArchive::new(file).map_err(|error| (format!("is no npz ({error})"), ARRAYS))?;
    let mut table = TableFile::default();
    let (mut place, mut value): (Option<String>, Option<String>) = (None, None);
    for k in 0..archive.len() {
        let entry = archive.by_index(k).map_err(|error| (format!("is no npz ({error})"), ARRAYS))?;
        let name = entry.name().map_err(|error| (format!("is no npz ({error})"), ARRAYS))?;
        let name = name.trim_end_matches(".npy").to_owned();
        let mut bytes = Vec::new();
        entry
            .take(GREATEST)
            .read_to_end(&mut bytes)
            .map_err(|error| (format!("has an array \"{name}\" that cannot be read ({error})"), ARRAYS))?;
        let numbers = npy(&bytes).ok_or_else(|| {
            (
                format!("has an array \"{name}\" that is not a list of real numbers"),
                "save it as float64, in one dimension",
            )
        })?;
        let single = numbers.first().copied();
        match name.as_str() {
            "knee" => table.knee = single,
            "tail_exponent" => table.tail_exponent = single,
            "tail_cut" => table.cut = single.map(|cut| cut != 0.0),
            _ => match Column::named(&name) {
                Some(Column::Angle | Column::Slope) if place.is_none() => {
                    table.places = numbers;
                    place = Some(name);
                }
                Some(Column::Value(_)) if value.is_none() => {
                    table.values = numbers;
                    value = Some(name);
                }
                _ => return Err((format!("has an array \"{name}\""), ARRAYS)),
            },
        }
    }
    let (Some(place), Some(value)) = (place, value) else {
        return Err(("has not both of its arrays".to_owned(), ARRAYS));
    };
    name_columns(&mut table, &place, &value);
    Ok(table)
}

/// An array of NumPy's format 1.0 to 3.0, flat; `None` if it is no list of real numbers.
fn npy(bytes: &[u8]) -> Option<Vec<f64>> {
    let rest = bytes.strip_prefix(b"\x93NUMPY")?;
    let (length, start): (usize, usize) = match rest.first()? {
        1 => (usize::from(u16::from_le_bytes(rest.get(2..4)?.try_into().ok()?)), 4),
        2 | 3 => (u32::from_le_bytes(rest.get(2..6)?.try_into().ok()?) as usize, 6),
        _ => return None,
    };
    let header = std::str::from_utf8(rest.get(start..start.checked_add(length)?)?).ok()?;
    let data = rest.get(start + length..)?;
    let after = |key: &str| header.split_once(key).map(|(_, rest)| rest.trim_start_matches([':', ' ', '\'']));
    let shape = after("'shape'")?.trim_start_matches('(').split(')').next()?;
    if shape.split(',').filter(|size| !size.trim().is_empty()).count() > 1 {
        return None;
    }
    let numbers = |width: usize, read: &dyn Fn(&[u8]) -> Option<f64>| data.chunks_exact(width).map(read).collect();
    macro_rules! of {
        ($type:ty) => {
            numbers(size_of::<$type>(), &|b| Some(<$type>::from_le_bytes(b.try_into().ok()?) as f64))
        };
    }
    match after("'descr'")?.split('\'').next()? {
        "<f8" => of!(f64),
        "<f4" => of!(f32),
        "<i8" => of!(i64),
        "<i4" => of!(i32),
        "<i2" => of!(i16),
        "<u8" => of!(u64),
        "<u4" => of!(u32),
        "<u2" => of!(u16),
        "|u1" | "|b1" => of!(u8),
        "|i1" => of!(i8),
        _ => None,
    }
}
