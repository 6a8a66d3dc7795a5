// Real spherical harmonics up to degree 3, the constant one left out.

const SH_C1: f32 = 0.48860252;
const SH_C2: vec3<f32> = vec3(1.0925484, 0.31539157, 0.5462742);
const SH_C3: array<f32, 5> = array(0.5900436, 2.8906114, 0.4570458, 0.37317633, 1.4453057);

// Values at a unit direction.
fn basis(degree: u32, direction: vec3<f32>) -> array<f32, 15> {
    var values: array<f32, 15>;
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    if degree >= 1u {
        values[0] = -SH_C1 * y;
        values[1] = SH_C1 * z;
        values[2] = -SH_C1 * x;
    }
    if degree >= 2u {
        values[3] = SH_C2.x * x * y;
        values[4] = -SH_C2.x * y * z;
        values[5] = SH_C2.y * (2.0 * z * z - x * x - y * y);
        values[6] = -SH_C2.x * x * z;
        values[7] = SH_C2.z * (x * x - y * y);
    }
    if degree >= 3u {
        let xx = x * x;
        let yy = y * y;
        let zz = z * z;
        values[8] = -SH_C3[0] * y * (3.0 * xx - yy);
        values[9] = SH_C3[1] * x * y * z;
        values[10] = -SH_C3[2] * y * (4.0 * zz - xx - yy);
        values[11] = SH_C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
        values[12] = -SH_C3[2] * x * (4.0 * zz - xx - yy);
        values[13] = SH_C3[4] * z * (xx - yy);
        values[14] = -SH_C3[0] * x * (xx - 3.0 * yy);
    }
    return values;
}

// Gradient by the direction (as a free vector) from gradients by the values.
fn basis_vjp(degree: u32, direction: vec3<f32>, g: array<f32, 15>) -> vec3<f32> {
    var gradient = vec3<f32>();
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    if degree >= 1u {
        gradient += SH_C1 * vec3(-g[2], -g[0], g[1]);
    }
    if degree >= 2u {
        gradient += SH_C2.x * vec3(g[3] * y - g[6] * z, g[3] * x - g[4] * z, -g[4] * y - g[6] * x);
        gradient += SH_C2.y * g[5] * vec3(-2.0 * x, -2.0 * y, 4.0 * z);
        gradient += SH_C2.z * g[7] * vec3(2.0 * x, -2.0 * y, 0.0);
    }
    if degree >= 3u {
        let xx = x * x;
        let yy = y * y;
        let zz = z * z;
        gradient -= SH_C3[0] * g[8] * vec3(6.0 * x * y, 3.0 * (xx - yy), 0.0);
        gradient += SH_C3[1] * g[9] * vec3(y * z, x * z, x * y);
        gradient -= SH_C3[2] * g[10] * vec3(-2.0 * x * y, 4.0 * zz - xx - 3.0 * yy, 8.0 * y * z);
        gradient += SH_C3[3] * g[11] * vec3(-6.0 * x * z, -6.0 * y * z, 6.0 * zz - 3.0 * (xx + yy));
        gradient -= SH_C3[2] * g[12] * vec3(4.0 * zz - 3.0 * xx - yy, -2.0 * x * y, 8.0 * x * z);
        gradient += SH_C3[4] * g[13] * vec3(2.0 * x * z, -2.0 * y * z, xx - yy);
        gradient -= SH_C3[0] * g[14] * vec3(3.0 * (xx - yy), -6.0 * x * y, 0.0);
    }
    return gradient;
}
