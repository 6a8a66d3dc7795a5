// Sine and cosine of any angle in radians. The built-in functions need only be right between -pi and pi, and
// to eleven bits; encodings and cycles go far beyond. Polynomials of Cephes (`sinf.c`).
fn sin_cos(angle: f32) -> vec2<f32> {
    let quarters = round(angle * 0.63661977);
    // Quarter turns in three parts; the products with the first are exact.
    let r = ((angle - quarters * 1.5703125) - quarters * 4.837512969970703e-4)
        - quarters * 7.549789948768648e-8;
    let z = r * r;
    let s = r + r * z * (-1.6666654611e-1 + z * (8.3321608736e-3 - z * 1.9515295891e-4));
    let c = 1.0 - 0.5 * z
        + z * z * (4.166664568298827e-2 + z * (-1.388731625493765e-3 + z * 2.443315711809948e-5));
    switch i32(quarters) & 3 {
        case 0: {
            return vec2(s, c);
        }
        case 1: {
            return vec2(c, -s);
        }
        case 2: {
            return vec2(-s, -c);
        }
        default: {
            return vec2(-c, s);
        }
    }
}
