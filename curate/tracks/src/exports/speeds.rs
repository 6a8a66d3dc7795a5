//! `speeds`: CSV with place, speed and heading of each vehicle at each frame.
//!
//! Metres are those of the georeference where there is one, else those of the tracks. With a georeference places are
//! east, north and up of its origin and headings clockwise from north. Without one, places are along the axes of the
//! ground and headings counterclockwise from the first.

use omnilife_schemas::plain_text::for_spreadsheet;

use super::{Content, TrackExport, TrackFormat};
use crate::georeference::geodesy;

/// The format.
pub const FORMAT: TrackFormat = TrackFormat {
    id: "speeds",
    about: "CSV with place, speed (m/s) and heading (degrees) of each vehicle at each frame",
    file: "tracks.csv",
    content: Content::Text(write),
};

const COLUMNS: [&str; 4] = ["track", "class", "frame", "time_seconds"];
const ON_THE_MAP: [&str; 7] = [
    "east_metres",
    "north_metres",
    "up_metres",
    "speed_metres_per_second",
    "heading_degrees_from_north",
    "latitude_degrees",
    "longitude_degrees",
];
/// The last column: [`super::moments::Evidence`].
const EVIDENCE: &str = "evidence";
const ON_THE_GROUND: [&str; 5] = [
    "x_metres",
    "y_metres",
    "z_metres",
    "speed_metres_per_second",
    "heading_degrees_from_x",
];

fn write(export: &TrackExport<'_>) -> Result<String, String> {
    let table = table(export).map_err(|error| error.to_string())?;
    let bytes = table.into_inner().map_err(|error| error.to_string())?;
    String::from_utf8(bytes).map_err(|error| error.to_string())
}

fn table(export: &TrackExport<'_>) -> csv::Result<csv::Writer<Vec<u8>>> {
    let mut table = csv::Writer::from_writer(Vec::new());
    let of_place = match export.georeference {
        Some(_) => &ON_THE_MAP[..],
        None => &ON_THE_GROUND[..],
    };
    table.write_record(COLUMNS.iter().chain(of_place).chain([&EVIDENCE]))?;
    for track in &export.tracks.tracks {
        let class = for_spreadsheet(&track.class);
        for moment in export.moments(track) {
            let mut row = vec![
                track.id.to_string(),
                class.to_string(),
                moment.frame.to_string(),
                moment.seconds.to_string(),
            ];
            row.extend(moment.place.to_array().map(|metres| format!("{metres:.3}")));
            row.push(format!("{:.3}", moment.speed));
            row.push(format!("{:.2}", moment.heading));
            if let Some(georeference) = export.georeference {
                let point = geodesy::from_enu(&georeference.origin, moment.place);
                row.push(format!("{:.9}", point.latitude_degrees));
                row.push(format!("{:.9}", point.longitude_degrees));
            }
            row.push(moment.evidence.name().to_owned());
            table.write_record(&row)?;
        }
    }
    Ok(table)
}
