//! What distributions are made from: keys, files, and errors that say what to mend.

use sgtd_core::error::ParameterError;
use sgtd_core::family::shape::Shape;
use sgtd_core::ndf::Ndf;
use sgtd_core::radial::{Kind, Radial, TableSource, read_table};
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

const SLOPES: [f64; 4] = [0.0, 0.1, 0.3, 1.0];
const VALUES: [f64; 4] = [4.0, 3.0, 1.0, 0.01];

fn given() -> TableSource {
    TableSource {
        places: SLOPES.to_vec(),
        by_angles: false,
        values: VALUES.to_vec(),
        quantity: "slope".to_owned(),
        tail: "power".to_owned(),
        tail_exponent: Some(4.5),
        knee: None,
        path: String::new(),
    }
}

fn table(given: TableSource) -> Radial {
    Radial::table(&given).unwrap_or_else(|error| panic!("{error}"))
}

fn family(gamma: f64) -> Radial {
    Radial::family(Shape::new(gamma, 1.0, 0.0, 0.0).unwrap_or_else(|error| panic!("{error}")))
}

fn mixture(parts: &[(f64, f64, Radial)]) -> Radial {
    Radial::mixture(parts).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn equal_keys_are_equal_distributions() {
    let all = [
        family(2.0),
        family(2.5),
        table(given()),
        table(TableSource { tail: "cut".to_owned(), tail_exponent: None, ..given() }),
        table(TableSource { tail_exponent: Some(5.0), ..given() }),
        table(TableSource { knee: Some(0.3), ..given() }),
        table(TableSource { quantity: "D".to_owned(), ..given() }),
        mixture(&[(0.3, 0.1, family(2.0)), (0.7, 0.5, table(given()))]),
        mixture(&[(0.4, 0.1, family(2.0)), (0.6, 0.5, table(given()))]),
        mixture(&[(0.3, 0.1, family(2.0)), (0.7, 0.6, table(given()))]),
        mixture(&[(0.3, 0.1, family(2.5)), (0.7, 0.5, table(given()))]),
    ];
    for (i, a) in all.iter().enumerate() {
        for (j, b) in all.iter().enumerate() {
            assert_eq!(a.key() == b.key(), i == j, "{i} and {j}");
        }
    }
    // values count up to a factor, weights too
    let twice = VALUES.map(|value| 2.0 * value);
    assert_eq!(table(given()).key(), table(TableSource { values: twice.to_vec(), ..given() }).key());
    let parts = |factor: f64| mixture(&[(0.25 * factor, 0.1, family(2.0)), (0.5 * factor, 0.5, family(3.0))]);
    assert_eq!(parts(1.0).key(), parts(2.0).key());
    assert_eq!(all.each_ref().map(|radial| radial.kind() == Kind::Table)[1..4], [false, true, true]);
}

#[test]
fn at_its_width_a_table_is_as_it_was_given() {
    let radial = table(TableSource { quantity: "D".to_owned(), ..given() });
    let width = radial.width();
    let ndf = Ndf::shared(Arc::clone(radial.profile()), 1e-5, true).unwrap_or_else(|error| panic!("{error}"));
    let d = |x: f64| {
        let f = radial.profile().f(x / width);
        ndf.profile().normalization() * f * x.mul_add(x, 1.0).powi(2)
    };
    for (x, value) in SLOPES.iter().zip(VALUES) {
        assert!((d(*x) / d(0.0) - value / VALUES[0]).abs() < 1e-12, "D at {x}");
    }
    let again = radial.as_table().map(|table| {
        let (x, f): (Vec<f64>, Vec<f64>) = table.nodes().map(|(x, f)| (x * width, f)).unzip();
        let exponent = table.tail_power();
        self::table(TableSource {
            places: x,
            values: f,
            knee: Some(table.knee() * width),
            tail_exponent: exponent,
            ..given()
        })
    });
    let again = again.unwrap_or_else(|| panic!("it is no table"));
    assert!((again.width() / width - 1.0).abs() < 1e-13);
    let fine = radial.resampled(200).unwrap_or_else(|error| panic!("{error}"));
    for x in [0.05, 0.5, 1.0, 2.0, 9.0] {
        let (got, want) = (fine.profile().sf(x / fine.width()), radial.profile().sf(x));
        assert!((got / want - 1.0).abs() < 1e-3, "{got:e} is not {want:e} at {x}");
    }
}

fn message<T>(result: Result<T, ParameterError>) -> String {
    result.err().map_or_else(|| panic!("it was accepted"), |error| error.to_string())
}

#[test]
fn errors_name_row_value_and_mend() {
    let refused = |given: TableSource| message(Radial::table(&given));
    for (given, words) in [
        (TableSource { places: vec![0.0, 0.3, 0.1, 1.0], ..given() }, "\"slopes\" in row 3 is 0.1"),
        (TableSource { values: vec![1.0, -0.5, 0.1, 0.1], ..given() }, "\"values\" in row 2 is -0.5"),
        (
            TableSource { values: vec![1.0, 0.5, f64::NAN, 0.1], quantity: "D".to_owned(), ..given() },
            "\"values\" in row 3 is NaN",
        ),
        (TableSource { places: vec![0.0], values: vec![1.0], ..given() }, "has 1 rows, but must have 2 to 1000"),
        (TableSource { values: vec![0.0; 4], ..given() }, "no mass"),
        (
            TableSource { tail_exponent: Some(2.5), ..given() },
            "\"tail_exponent\" is 2.5, but it must be greater than 3",
        ),
        (TableSource { values: vec![1.0; 4], tail_exponent: None, ..given() }, "too heavy a tail"),
        (TableSource { places: vec![0.0, 10.0, 95.0, 99.0], by_angles: true, ..given() }, "\"angles\" in row 3 is 95"),
        (TableSource { places: vec![0.0, 10.0, 5.0, 9.0], by_angles: true, ..given() }, "sort the rows"),
        (TableSource { quantity: "heights".to_owned(), ..given() }, "must be one of D, D_cos, slope"),
        (TableSource { tail: "gauss".to_owned(), ..given() }, "must be one of power, cut"),
        (TableSource { tail: "cut".to_owned(), ..given() }, "leave one of the two out"),
        (TableSource { knee: Some(-1.0), ..given() }, "\"knee\" is -1"),
        (TableSource { values: vec![1.0; 3], ..given() }, "\"values\" has 3 numbers, but 4 are needed"),
    ] {
        let found = refused(given);
        assert!(found.contains(words), "{found}");
    }
    let parts = |weight: f64, scale: f64| message(Radial::mixture(&[(weight, scale, family(2.0))]));
    assert!(parts(0.0, 1.0).contains("\"weights\" in row 1 is 0"), "{}", parts(0.0, 1.0));
    assert!(parts(1.0, f64::NAN).contains("\"alpha\" is NaN"), "{}", parts(1.0, f64::NAN));
    assert!(message(Radial::mixture(&[])).contains("0 rows"));
}

fn written(name: &str, bytes: &[u8]) -> String {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join(name);
    std::fs::File::create(&path).and_then(|mut file| file.write_all(bytes)).unwrap_or_else(|error| panic!("{error}"));
    path.to_string_lossy().into_owned()
}

/// A file of numpy.savez.
fn npz(arrays: &[(&str, &[f64])]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, numbers) in arrays {
        let shape = if numbers.len() == 1 { "()".to_owned() } else { format!("({},)", numbers.len()) };
        let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
        while (10 + header.len() + 1) % 64 != 0 {
            header.push(' ');
        }
        header.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        numbers.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
        let options = zip::write::SimpleFileOptions::default();
        zip.start_file(format!("{name}.npy"), options).unwrap_or_else(|error| panic!("{error}"));
        zip.write_all(&bytes).unwrap_or_else(|error| panic!("{error}"));
    }
    zip.finish().unwrap_or_else(|error| panic!("{error}")).into_inner()
}

#[test]
fn files_say_what_arguments_say() {
    let wanted = table(given());
    let rows: Vec<String> = SLOPES.iter().zip(VALUES).map(|(x, value)| format!("{x}, {value}")).collect();
    let named =
        written("named.csv", format!("# tail_exponent: 4.5\nslope,slope_density\n{}\n", rows.join("\n")).as_bytes());
    let read = |path: &str| table(read_table(path, None, None, None).unwrap_or_else(|error| panic!("{error}")));
    assert_eq!(read(&named).key(), wanted.key());
    let swapped: Vec<String> = SLOPES.iter().zip(VALUES).map(|(x, value)| format!("{value},{x}")).collect();
    let swapped = written("swapped.csv", format!("value,slopes\r\n{}", swapped.join("\r\n")).as_bytes());
    let given_beside = read_table(&swapped, Some("slope"), Some("power"), Some(4.5));
    assert_eq!(table(given_beside.unwrap_or_else(|error| panic!("{error}"))).key(), wanted.key());
    let more: Vec<String> = SLOPES.iter().zip(VALUES).map(|(x, value)| format!("7,{x},words,{value}")).collect();
    let more = written("more.csv", format!("n,slope,note,density\n{}", more.join("\n")).as_bytes());
    let of_more = read_table(&more, None, None, Some(4.5)).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(table(of_more).key(), wanted.key());
    let plain = written("plain.csv", b"0,1\n10,0.5\n20,0.1\n");
    let cut = read_table(&plain, Some("D_cos"), Some("cut"), None).unwrap_or_else(|error| panic!("{error}"));
    let angles = TableSource {
        places: vec![0.0, 10.0, 20.0],
        values: vec![1.0, 0.5, 0.1],
        by_angles: true,
        quantity: "D_cos".to_owned(),
        tail: "cut".to_owned(),
        tail_exponent: None,
        knee: None,
        path: String::new(),
    };
    let cut = table(cut);
    assert_eq!(cut.key(), table(angles.clone()).key());
    let packed = npz(&[("slopes", &SLOPES), ("slope_density", &VALUES), ("tail_exponent", &[4.5])]);
    assert_eq!(read(&written("table.npz", &packed)).key(), wanted.key());
    let packed = npz(&[("angles", &angles.places), ("D_cos", &angles.values), ("tail_cut", &[1.0])]);
    assert_eq!(read(&written("cut.npz", &packed)).key(), cut.key());
}

#[test]
fn errors_name_the_file() {
    let refused = |path: &str| message(read_table(path, None, None, None).and_then(|source| Radial::table(&source)));
    for (name, text, words) in [
        ("few.csv", "0,1\n", "few.csv: the table has 1 rows"),
        ("none.csv", "angle,D\n", "has no rows of numbers"),
        ("words.csv", "0,1\n5,much\n", "line 2 has \"much\", which is not a number"),
        ("wide.csv", "0,1,2\n5,1,2\n", "line 1 has 3 columns, but must have 2"),
        ("names.csv", "height,D\n0,1\n5,1\n", "line 1 names the columns height, D"),
        ("order.csv", "0,1\n5,0.5\n3,0.1\n", "order.csv: \"angles\" in row 3 is 3"),
        ("tail.csv", "# tail: gauss\n0,1\n5,0.1\n", "line 1 has a tail \"gauss\""),
        ("knee.csv", "# knee: x\n0,1\n5,0.1\n", "must be a number"),
        ("bad.npz", "no zip", "bad.npz: is no npz"),
    ] {
        let found = refused(&written(name, text.as_bytes()));
        assert!(found.contains(words), "{found}");
    }
    assert!(refused("/no/such/table.csv").contains("/no/such/table.csv: cannot be read"));
    let other = npz(&[("slopes", &SLOPES), ("heights", &VALUES)]);
    assert!(refused(&written("other.npz", &other)).contains("has an array \"heights\""));
    let half = npz(&[("slopes", &SLOPES)]);
    assert!(refused(&written("half.npz", &half)).contains("has not both of its arrays"));
}
