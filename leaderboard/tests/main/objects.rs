//! Layouts of input views: scores of objects with their deviations, means over sequences, published rows apart.

use std::collections::BTreeMap;

use omnilife_schemas::records::{
    Direction, ObjectClass, ObjectResult, ObjectResults, ResultRecord, Summary,
};

use crate::{
    leaderboard::{Place, study},
    support::{result, summary},
};

/// An object of input views with a mean and a deviation.
fn object(name: &str, class: ObjectClass, psnr: f64, deviation: Option<f64>) -> ObjectResult {
    let scored = Summary {
        standard_deviation: deviation,
        ..summary(psnr, 5)
    };
    ObjectResult {
        view: "input".to_owned(),
        object: name.to_owned(),
        class,
        scores: [("psnr-object".to_owned(), scored)].into(),
    }
}

/// A result of input views alone, whose LPIPS and temporal LPIPS follow from its PSNR.
fn of_input_views(
    scene: &str,
    method: &str,
    psnr: f64,
    objects: Vec<ObjectResult>,
) -> ResultRecord {
    let with = |mean: f64, deviation: f64, direction| Summary {
        standard_deviation: Some(deviation),
        direction,
        ..summary(mean, 5)
    };
    let scores = [
        ("psnr", with(psnr, 1.5, Some(Direction::HigherIsBetter))),
        (
            "lpips-alex",
            with(0.1, 0.01, Some(Direction::LowerIsBetter)),
        ),
        ("temporal-lpips", with(0.05, 0.02, None)),
    ];
    ResultRecord {
        protocol: "input-view/3".to_owned(),
        input_views: scores
            .map(|(metric, summary)| (metric.to_owned(), summary))
            .into(),
        novel_views: [].into(),
        objects: Some(ObjectResults::new("objects.csv".to_owned(), objects)),
        ..result(scene, method, psnr, 0.9)
    }
}

fn results() -> Vec<ResultRecord> {
    use ObjectClass::{Person, Vehicle};
    let street = |shift: f64| {
        vec![
            object("car", Vehicle, 30.0 + shift, Some(2.0)),
            object("bus", Vehicle, 20.0 + shift, None),
            object("walker", Person, 25.0 + shift, Some(1.0)),
        ]
    };
    let hall = |shift: f64| vec![object("car", Vehicle, 40.0 + shift, Some(4.0))];
    vec![
        of_input_views("street", "nag", 34.0, street(0.0)),
        of_input_views("hall", "nag", 36.0, hall(0.0)),
        of_input_views("street", "odgs", 30.0, street(-3.0)),
        of_input_views("hall", "odgs", 31.0, hall(-3.0)),
        of_input_views("street", "nag-without-flow", 32.0, street(-1.0)),
        of_input_views("hall", "nag-without-flow", 33.0, hall(-1.0)),
    ]
}

/// Values of a layout's CSV by origin, row and column, and the standings.
type Cells = BTreeMap<(String, String, String), (f64, String)>;

fn cells(place: &Place, layout: &str) -> Cells {
    let text = place.read(&format!("tables/input-view-3-a34df006b285/{layout}.csv"));
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let records = reader.records().map(Result::unwrap);
    records
        .filter_map(|record| {
            let key = (
                format!("{} {}", &record[1], &record[2]).trim().to_owned(),
                record[4].to_owned(),
                record[5].to_owned(),
            );
            Some((key, (record[6].parse().ok()?, record[9].to_owned())))
        })
        .collect()
}

fn at(cells: &Cells, origin: &str, row: &str, column: &str) -> Option<(f64, String)> {
    let mut found = cells.iter().filter(|((of, in_row, in_column), _)| {
        of.starts_with(origin) && in_row == row && in_column == column
    });
    let (_, value) = found.next()?;
    Some(value.clone())
}

#[test]
fn objects_are_means_over_frames_objects_and_sequences() {
    let place = Place::with(&results());
    place.build();
    let cells = cells(&place, "objects");
    let measured = |row: &str, column: &str| at(&cells, "measured", row, column);
    let value = |row: &str, column: &str| measured(row, column).map(|(value, _)| value);
    let (psnr, deviation) = ("Vehicle PSNR-OBJECT", "Vehicle PSNR-OBJECT ±");
    assert_eq!(value("street / nag", psnr), Some(25.0));
    assert_eq!(value("street / nag", deviation), Some(2.0));
    assert_eq!(value("Mean / nag", psnr), Some(32.5));
    assert_eq!(value("Mean / nag", deviation), Some(3.0));
    // One sequence shows no person: the mean is that of the other.
    assert_eq!(value("hall / nag", "Human PSNR-OBJECT"), None);
    assert_eq!(value("Mean / nag", "Human PSNR-OBJECT"), Some(25.0));
    assert_eq!(value("Mean / nag", "Other PSNR-OBJECT"), None);
    let standing = |row: &str| measured(row, psnr).map(|(_, standing)| standing);
    assert_eq!(standing("Mean / nag").as_deref(), Some("best"));
    assert_eq!(standing("Mean / odgs").as_deref(), Some(""));
    // Variants have a table of their own.
    assert_eq!(standing("Mean / nag-without-flow"), None);

    let table_4 = "published Authors' figures: Neural Atlas Graphs, Table 4:";
    let row = "s-975 / Neural Atlas Graphs (authors)";
    let printed = |column: &str| at(&cells, table_4, row, column).map(|(value, _)| value);
    assert_eq!(printed(psnr), Some(46.79));
    assert_eq!(printed(deviation), Some(1.21));
    let other = at(&cells, table_4, "s-125 / OmniRe", "Human PSNR-OBJECT");
    assert_eq!(other, None, "the paper has no person there");
    for table in [8, 12] {
        let origin = format!("published Authors' figures: Neural Atlas Graphs, Table {table}:");
        assert!(cells.keys().any(|(of, ..)| of.starts_with(&origin)));
    }
}

#[test]
fn layouts_of_input_views_have_their_published_tables() {
    let place = Place::with(&results());
    place.build();
    let images = cells(&place, "whole-images");
    let printed = |cells: &Cells, paper: &str, row: &str, column: &str| {
        let origin = format!("published Authors' figures: {paper}");
        at(cells, &origin, row, column).map(|(value, _)| value)
    };
    let nag = "Neural Atlas Graphs";
    let swan = "blackswan / Neural Atlas Graphs (authors)";
    assert_eq!(printed(&images, nag, swan, "PSNR"), Some(36.36));
    assert_eq!(printed(&images, nag, swan, "PSNR ±"), Some(0.53));
    let (_, standing) = at(&images, "measured", "street / nag", "PSNR").unwrap();
    assert_eq!(standing, "best");
    let deviation = at(&images, "measured", "Mean / odgs", "PSNR ±");
    assert_eq!(deviation.map(|(value, _)| value), Some(1.5));
    let uav = "Gaussian splatting from UAV full motion videos";
    let campus = format!("Campus region / {uav} (authors)");
    assert_eq!(printed(&images, uav, &campus, "PSNR"), Some(25.93));

    let over_time = cells(&place, "consistency-over-time");
    let davis = "DAVIS / Layered Neural Atlases";
    assert_eq!(printed(&over_time, nag, davis, "FVD"), Some(595.0));
    assert_eq!(at(&over_time, "measured", "street / nag", "FVD"), None);

    let ablation = cells(&place, "ablation-of-input-views");
    let without = at(&ablation, "measured", "w/o flow", "Vehicle PSNR-OBJECT");
    assert_eq!(without.map(|(value, _)| value), Some(31.5));
    let small = printed(&ablation, nag, "Small", "Human PSNR-OBJECT");
    assert_eq!(small, Some(36.9));
}

#[test]
fn other_protocols_have_no_tables_of_input_views() {
    let place = Place::with(&study());
    place.build();
    let folder = place.request.out.join("tables/per-scene-1-a34df006b285");
    for layout in ["whole-images", "objects", "consistency-over-time"] {
        assert!(!folder.join(format!("{layout}.md")).exists(), "{layout}");
    }
}
