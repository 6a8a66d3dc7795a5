// atan2 to the last bits. WGSL's built-in may be off by 4096 of them, a fiftieth of a pixel.
fn arc_tangent(y: f32, x: f32) -> f32 {
    let larger = max(abs(x), abs(y));
    if larger == 0.0 {
        return 0.0;
    }
    var t = min(abs(x), abs(y)) / larger;
    var angle = 0.0;
    // Above tan(pi/8): expand around pi/4.
    if t > 0.41421356 {
        t = (t - 1.0) / (t + 1.0);
        angle = 0.78539816339745;
    }
    // Minimax polynomial on [0, tan(pi/8)] (Cephes atanf).
    let z = t * t;
    angle += (((8.05374449538e-2 * z - 1.38776856032e-1) * z + 1.99777106478e-1) * z
        - 3.33329491539e-1) * z * t + t;
    if abs(y) > abs(x) {
        angle = 1.5707963267949 - angle;
    }
    if x < 0.0 {
        angle = 3.14159265358979 - angle;
    }
    return select(angle, -angle, y < 0.0);
}
