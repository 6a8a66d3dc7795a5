//! `speeds`: CSV with place, speed and heading of each vehicle at each frame.
//!
//! Metres are those of the georeference where there is one, else those of the tracks. With a georeference places are
//! east, north and up of its origin and headings clockwise from north. Without one, places are along the axes of the
//! ground and headings counterclockwise from the first.

use std::fmt::Write as _;

use super::{TrackExport, TrackFormat};
use crate::georeference::geodesy;

/// The format.
pub const FORMAT: TrackFormat = TrackFormat {
    id: "speeds",
    about: "CSV with place, speed (m/s) and heading (degrees) of each vehicle at each frame",
    file: "tracks.csv",
    write,
};

fn write(export: &TrackExport<'_>) -> Result<String, String> {
    let mut text = "track,class,frame,time_seconds,".to_owned();
    text += if export.georeference.is_some() {
        "east_metres,north_metres,up_metres,speed_metres_per_second,heading_degrees_from_north,latitude_degrees,\
         longitude_degrees\n"
    } else {
        "x_metres,y_metres,z_metres,speed_metres_per_second,heading_degrees_from_x\n"
    };
    for track in &export.tracks.tracks {
        let class = quoted(&track.class);
        for moment in export.moments(track) {
            let [x, y, z] = moment.place.to_array();
            let _ = write!(
                text,
                "{},{class},{},{},{x:.3},{y:.3},{z:.3},{:.3},{:.2}",
                track.id, moment.frame, moment.seconds, moment.speed, moment.heading
            );
            if let Some(georeference) = export.georeference {
                let point = geodesy::from_enu(&georeference.origin, moment.place);
                let (latitude, longitude) = (point.latitude_degrees, point.longitude_degrees);
                let _ = write!(text, ",{latitude:.9},{longitude:.9}");
            }
            text.push('\n');
        }
    }
    Ok(text)
}

/// Returns a text as a field of CSV.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}
