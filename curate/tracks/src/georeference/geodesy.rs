//! Coordinates on the ellipsoid WGS 84: geodetic, east-north-up, UTM.
//!
//! UTM is the transverse Mercator projection by the series of Krüger (1912) in the third flattening to its fourth
//! power; within a zone it is exact to a micrometre (Karney, Transverse Mercator with an accuracy of a few nanometers,
//! 2011).

use glam::{DMat3, DVec3, dvec3};
use omnilife_schemas::records::{GeoPoint, UtmPoint};

/// Semi-major axis, metres.
const AXIS: f64 = 6_378_137.0;
/// Flattening.
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Square of the first eccentricity.
const ECCENTRICITY_2: f64 = FLATTENING * (2.0 - FLATTENING);
/// Scale of UTM on its central meridian.
const UTM_SCALE: f64 = 0.9996;
/// Easting of the central meridian, metres.
const FALSE_EASTING: f64 = 5e5;
/// Northing of the equator on the southern hemisphere, metres.
const FALSE_NORTHING: f64 = 1e7;

/// Returns Earth-centred coordinates, metres.
fn earth_centred(point: &GeoPoint) -> DVec3 {
    let (sin, cos) = point.latitude_degrees.to_radians().sin_cos();
    let (sin_lon, cos_lon) = point.longitude_degrees.to_radians().sin_cos();
    let normal = AXIS / (1.0 - ECCENTRICITY_2 * sin * sin).sqrt();
    let out = (normal + point.altitude_metres) * cos;
    let up = (normal * (1.0 - ECCENTRICITY_2) + point.altitude_metres) * sin;
    dvec3(out * cos_lon, out * sin_lon, up)
}

/// Returns the point of Earth-centred coordinates.
fn geodetic(place: DVec3) -> GeoPoint {
    let out = place.x.hypot(place.y);
    let mut latitude = place.z.atan2(out * (1.0 - ECCENTRICITY_2));
    let mut normal = AXIS;
    // Each round gains two digits and more near the ground.
    for _ in 0..10 {
        let sin = latitude.sin();
        normal = AXIS / (1.0 - ECCENTRICITY_2 * sin * sin).sqrt();
        latitude = (place.z + ECCENTRICITY_2 * normal * sin).atan2(out);
    }
    let (sin, cos) = latitude.sin_cos();
    // Of the two equations the one that is not near 0 / 0.
    let altitude = if cos > 0.5 {
        out / cos - normal
    } else {
        place.z / sin - normal * (1.0 - ECCENTRICITY_2)
    };
    GeoPoint {
        latitude_degrees: latitude.to_degrees(),
        longitude_degrees: place.y.atan2(place.x).to_degrees(),
        altitude_metres: altitude,
    }
}

/// Returns the axes east, north and up of a point, as columns.
fn axes(origin: &GeoPoint) -> DMat3 {
    let (sin, cos) = origin.latitude_degrees.to_radians().sin_cos();
    let (sin_lon, cos_lon) = origin.longitude_degrees.to_radians().sin_cos();
    DMat3::from_cols(
        dvec3(-sin_lon, cos_lon, 0.0),
        dvec3(-sin * cos_lon, -sin * sin_lon, cos),
        dvec3(cos * cos_lon, cos * sin_lon, sin),
    )
}

/// Returns east, north and up of a point from an origin, metres.
pub fn enu(origin: &GeoPoint, point: &GeoPoint) -> DVec3 {
    axes(origin).transpose() * (earth_centred(point) - earth_centred(origin))
}

/// Returns the point at some metres east, north and up of an origin.
pub fn from_enu(origin: &GeoPoint, enu: DVec3) -> GeoPoint {
    geodetic(earth_centred(origin) + axes(origin) * enu)
}

/// Returns the UTM zone of a longitude in degrees, without the exceptions of Norway and Svalbard.
pub fn utm_zone(longitude_degrees: f64) -> u8 {
    let turns = (longitude_degrees + 180.0).rem_euclid(360.0);
    (turns / 6.0).floor().clamp(0.0, 59.0) as u8 + 1
}

/// Returns a point in UTM, in the zone of its longitude.
pub fn utm(point: &GeoPoint) -> UtmPoint {
    utm_in(point, utm_zone(point.longitude_degrees))
}

/// Returns a point in a zone of UTM; its longitude must be within some degrees of the zone.
pub fn utm_in(point: &GeoPoint, zone: u8) -> UtmPoint {
    let n = FLATTENING / (2.0 - FLATTENING);
    let powers = [n, n.powi(2), n.powi(3), n.powi(4)];
    let series = |factors: [f64; 4]| -> f64 {
        let terms = factors.iter().zip(powers);
        terms.map(|(factor, power)| factor * power).sum()
    };
    let alpha = [
        series([0.5, -2.0 / 3.0, 5.0 / 16.0, 41.0 / 180.0]),
        series([0.0, 13.0 / 48.0, -3.0 / 5.0, 557.0 / 1440.0]),
        series([0.0, 0.0, 61.0 / 240.0, -103.0 / 140.0]),
        series([0.0, 0.0, 0.0, 49561.0 / 161_280.0]),
    ];
    // Radius of the rectifying sphere.
    let radius = AXIS / (1.0 + n) * (1.0 + n * n / 4.0 + n.powi(4) / 64.0);
    let meridian = 6.0 * f64::from(zone) - 183.0;
    let sin = point.latitude_degrees.to_radians().sin();
    let aside = (point.longitude_degrees - meridian).to_radians();
    let eccentricity = 2.0 * n.sqrt() / (1.0 + n);
    // Tangent of the conformal latitude.
    let tangent = (sin.atanh() - eccentricity * (eccentricity * sin).atanh()).sinh();
    let xi = tangent.atan2(aside.cos());
    let eta = (aside.sin() / tangent.hypot(1.0)).atanh();
    let (mut east, mut north) = (eta, xi);
    for (number, factor) in (1..).zip(alpha) {
        let twice = 2.0 * f64::from(number);
        east += factor * (twice * xi).cos() * (twice * eta).sinh();
        north += factor * (twice * xi).sin() * (twice * eta).cosh();
    }
    let is_north = point.latitude_degrees >= 0.0;
    let equator = if is_north { 0.0 } else { FALSE_NORTHING };
    UtmPoint {
        zone,
        is_north,
        easting: FALSE_EASTING + UTM_SCALE * radius * east,
        northing: equator + UTM_SCALE * radius * north,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(latitude: f64, longitude: f64, altitude: f64) -> GeoPoint {
        GeoPoint {
            latitude_degrees: latitude,
            longitude_degrees: longitude,
            altitude_metres: altitude,
        }
    }

    #[test]
    fn utm_is_that_of_known_places() {
        // The Eiffel Tower, and Sydney on the southern hemisphere.
        for (place, zone, is_north, east, north) in [
            (
                point(48.8582, 2.2945, 0.0),
                31,
                true,
                448_251.795_2,
                5_411_932.677_7,
            ),
            (
                point(-33.8568, 151.2153, 0.0),
                56,
                false,
                334_900.569_7,
                6_252_288.752_9,
            ),
        ] {
            let found = utm(&place);
            assert_eq!((found.zone, found.is_north), (zone, is_north));
            assert!((found.easting - east).abs() < 0.01, "{}", found.easting);
            assert!((found.northing - north).abs() < 0.01, "{}", found.northing);
        }
        // On the central meridian easting is exact and distances are those of the meridian.
        let [a, b] = [50.0, 50.001].map(|latitude| utm(&point(latitude, 9.0, 0.0)));
        assert!((a.easting - 5e5).abs() < 1e-6);
        let along = enu(&point(50.0, 9.0, 0.0), &point(50.001, 9.0, 0.0)).length();
        assert!(((b.northing - a.northing) / along - UTM_SCALE).abs() < 1e-6);
    }

    #[test]
    fn east_north_up_returns_to_the_point() {
        for (latitude, longitude) in [(48.0, 11.0), (-33.9, 151.2), (0.0, -179.9), (89.0, 10.0)] {
            let origin = point(latitude, longitude, 120.0);
            for offset in [dvec3(0.0, 0.0, 50.0), dvec3(300.0, -200.0, 10.0)] {
                let place = from_enu(&origin, offset);
                assert!((enu(&origin, &place) - offset).length() < 1e-6);
            }
            let above = from_enu(&origin, dvec3(0.0, 0.0, 30.0));
            assert!((above.altitude_metres - 150.0).abs() < 1e-6);
            let north = from_enu(&origin, dvec3(0.0, 10.0, 0.0));
            assert!(north.latitude_degrees > latitude);
        }
    }
}
