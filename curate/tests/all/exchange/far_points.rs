//! Points of georeferenced scenes, whose coordinates 32-bit floats do not hold.

use omnilife_curate::exchange::written_formats;
use omnilife_schemas::points::PointCloud;

use crate::exchange::{round_trip, scene};

#[test]
fn points_far_from_the_origin_come_back_exactly() {
    let (folder, original) = scene();
    let wave = |n: u32| (0.7 * f64::from(n)).sin();
    let at = |n: u32| {
        [
            448_262.3 + wave(n),
            5_411_932.7 + wave(n + 40),
            wave(n + 90),
        ]
    };
    let points = PointCloud::of_colour((0..30).map(at).collect(), [1, 2, 3]);
    points.write_ply(&folder.path().join("points.ply")).unwrap();
    // The only format that holds none.
    for format in written_formats().filter(|format| format.id != "hm3d") {
        let (export, imported) = round_trip(format.id, folder.path(), &original.id);
        let back = export.path().join("back");
        let read = PointCloud::read_ply(&back.join(imported.points.unwrap())).unwrap();
        assert_eq!(read, points, "{}", format.id);
    }
}
