// Order of Gaussians in memory: positions on a Z-order curve over the sphere.

const QUARTER_TURN: f32 = 1.5707963267948966;

// Angle whose tangent is `y / x`, to the last bits: built-in functions need only be right to eleven bits.
// Polynomial of Cephes (`atanf.c`).
fn angle_of(y: f32, x: f32) -> f32 {
    let least = min(abs(x), abs(y));
    let largest = max(abs(x), abs(y));
    if largest == 0.0 {
        return 0.0;
    }
    var t = least / largest;
    var angle = 0.0;
    // tan(pi / 8).
    if t > 0.41421356 {
        t = (t - 1.0) / (t + 1.0);
        angle = 0.5 * QUARTER_TURN;
    }
    let z = t * t;
    let series = 8.05374449538e-2 * z - 1.38776856032e-1;
    angle += ((series * z + 1.99777106478e-1) * z - 3.33329491539e-1) * z * t + t;
    if abs(y) > abs(x) {
        angle = QUARTER_TURN - angle;
    }
    if x < 0.0 {
        angle = 2.0 * QUARTER_TURN - angle;
    }
    return select(angle, -angle, y < 0.0);
}

// Position of a direction, of any length, on a Z-order curve over longitude and latitude.
fn z_order(direction: vec3<f32>) -> u32 {
    let level = length(direction.xz);
    let across = angle_of(direction.x, direction.z) / (4.0 * QUARTER_TURN) + 0.5;
    let down = angle_of(direction.y, level) / (2.0 * QUARTER_TURN) + 0.5;
    let has_longitude = !is_nan(direction.x) && !is_nan(direction.z);
    let has_latitude = has_longitude && !is_nan(direction.y);
    return spread(cell(across, has_longitude)) | spread(cell(down, has_latitude)) << 1u;
}

// NaN falls in the first cell.
fn cell(share: f32, is_number: bool) -> u32 {
    return select(0u, u32(clamp(share * 65535.0, 0.0, 65535.0)), is_number && !is_nan(share));
}

// Spreads the bits of a number to the even positions.
fn spread(bits: u32) -> u32 {
    var spread = bits;
    spread = (spread | spread << 8u) & 0x00ff00ffu;
    spread = (spread | spread << 4u) & 0x0f0f0f0fu;
    spread = (spread | spread << 2u) & 0x33333333u;
    return (spread | spread << 1u) & 0x55555555u;
}
