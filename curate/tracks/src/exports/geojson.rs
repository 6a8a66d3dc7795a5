//! `geojson`: the paths of vehicles as GeoJSON (RFC 7946): a line in longitude and latitude for each, with the times,
//! speeds and headings of its points. Heights are left out, because the reference of a drone's heights is not the
//! ellipsoid.

use omnilife_schemas::records::Track;
use serde_json::{Value, json};

use super::{Content, TrackExport, TrackFormat};
use crate::georeference::geodesy;

/// The format.
pub const FORMAT: TrackFormat = TrackFormat {
    id: "geojson",
    about: "paths in longitude and latitude, with times, speeds and headings; needs recorded positions",
    file: "tracks.geojson",
    content: Content::Text(write),
};

/// Digits of a degree: a tenth of a millimetre.
const DIGITS: f64 = 1e9;

fn write(export: &TrackExport<'_>) -> Result<String, String> {
    let Some(georeference) = export.georeference else {
        return Err(
            "has no place on the Earth for geojson: --telemetry FILE.srt, or stills with positions in EXIF".to_owned(),
        );
    };
    let tracks = export.tracks.tracks.iter();
    let features: Vec<Value> = tracks.filter_map(|track| feature(export, track)).collect();
    let residuals = &georeference.residuals;
    let collection = json!({
        "type": "FeatureCollection",
        "name": export.tracks.scene,
        "georeference": {
            "source": georeference.source,
            "positions": residuals.used,
            "median_residual_metres": residuals.median_metres,
            "p90_residual_metres": residuals.p90_metres,
        },
        "features": features,
    });
    Ok(format!("{collection}\n"))
}

/// Returns the feature of a vehicle; `None` for one without a frame in its time.
fn feature(export: &TrackExport<'_>, track: &Track) -> Option<Value> {
    let georeference = export.georeference?;
    let moments = export.moments(track);
    let places = moments.iter().map(|moment| {
        let point = geodesy::from_enu(&georeference.origin, moment.place);
        [point.longitude_degrees, point.latitude_degrees]
            .map(|value| (value * DIGITS).round() / DIGITS)
    });
    let places: Vec<[f64; 2]> = places.collect();
    let geometry = match places.as_slice() {
        [] => return None,
        [place] => json!({ "type": "Point", "coordinates": place }),
        _ => json!({ "type": "LineString", "coordinates": places }),
    };
    let rounded = |value: f64| (value * 1e3).round() / 1e3;
    let values = |value: fn(&super::moments::Moment) -> f64| -> Vec<f64> {
        moments.iter().map(value).map(rounded).collect()
    };
    let [length, width, height] = track
        .dimensions
        .map(|side| rounded(side * georeference.metres_per_unit));
    let evidence: Vec<&str> = moments.iter().map(|one| one.evidence.name()).collect();
    Some(json!({
        "type": "Feature",
        "id": track.id,
        "geometry": geometry,
        "properties": {
            "track": track.id,
            "class": track.class,
            "length_metres": length,
            "width_metres": width,
            "height_metres": height,
            "times_seconds": values(|moment| moment.seconds),
            "speeds_metres_per_second": values(|moment| moment.speed),
            "headings_degrees": values(|moment| moment.heading),
            "evidence": evidence,
        },
    }))
}
