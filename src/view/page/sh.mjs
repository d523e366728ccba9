// Spherical harmonics: real, orthonormal, no Condon-Shortley sign, index l(l+1)+m, as the program has them:
// Y_1,-1 = 0.4886 y, Y_1,0 = 0.4886 z, Y_1,1 = 0.4886 x.

/** All Y_lm with l < bands at the unit vector (x, y, z), written to out[0 .. bands²]. */
export function evaluateBasis(bands, x, y, z, out) {
  // Associated Legendre functions without the factor sin^m, times r^m cos mφ and r^m sin mφ.
  let cosine = 1, sine = 0; // r^m cos mφ, r^m sin mφ
  let diagonal = Math.sqrt(1 / (4 * Math.PI));
  for (let m = 0; m < bands; m++) {
    if (m > 0) {
      [cosine, sine] = [x * cosine - y * sine, x * sine + y * cosine];
      diagonal *= Math.sqrt((2 * m + 1) / (2 * m));
    }
    const double = m > 0 ? Math.SQRT2 : 1;
    let before = 0, here = diagonal;
    for (let l = m; l < bands; l++) {
      out[l * l + l + m] = double * here * cosine;
      if (m > 0) out[l * l + l - m] = double * here * sine;
      const a = Math.sqrt((4 * (l + 1) * (l + 1) - 1) / ((l + 1) * (l + 1) - m * m));
      const b = Math.sqrt((l * l - m * m) / (4 * l * l - 1 || 1));
      [before, here] = [here, a * (z * here - b * before)];
    }
  }
  return out;
}

// Gauss-Legendre with three points on [−1, 1].
const GAUSS = [[-Math.sqrt(0.6), 5 / 9], [0, 8 / 9], [Math.sqrt(0.6), 5 / 9]];

/**
 * Coefficients of a lat-long image in the upright frame (+z up), red, green and blue side by side. Longitude π is at
 * the left edge, 0 in the middle (+x, as in Blender and three.js). Each pixel counts with the integral of the basis over it: exact along its row, by
 * three points of Gauss across. Pixels that no light can have (negative, not finite) count as 0.
 */
export function projectLatLong(width, height, rgb, bands) {
  const sum = new Float64Array(3 * bands * bands);
  const step = (2 * Math.PI) / width;
  // Upright azimuth is longitude: probe (cos λ, ·, −sin λ) stands at upright (cos λ, sin λ, ·).
  const waves = [];
  for (let m = 0; m < bands; m++) {
    const share = m === 0 ? step : (2 * Math.sin((m * step) / 2)) / m;
    const wave = (f) => Float64Array.from({ length: width }, (_, i) => share * f(m * (Math.PI - step * (i + 0.5))));
    waves.push([wave(Math.cos), wave(Math.sin)]);
  }
  const basis = new Float64Array(bands * bands), profile = new Float64Array(bands * bands);
  const row = new Float64Array(3 * width);
  for (let j = 0; j < height; j++) {
    for (let i = 0; i < 3 * width; i++) {
      const v = rgb[i + 3 * width * j];
      row[i] = v > 0 && v < Infinity ? v : 0;
    }
    // ∫ over the row's latitudes of the basis at azimuth 0.
    profile.fill(0);
    for (const [node, weight] of GAUSS) {
      const latitude = Math.PI / 2 - (Math.PI * (j + 0.5 + 0.5 * node)) / height;
      evaluateBasis(bands, Math.cos(latitude), 0, Math.sin(latitude), basis);
      const part = ((weight * Math.PI) / height / 2) * Math.cos(latitude);
      for (let k = 0; k < basis.length; k++) profile[k] += part * basis[k];
    }
    for (let m = 0; m < bands; m++) {
      const [cosines, sines] = waves[m];
      const fourier = [0, 0, 0, 0, 0, 0];
      for (let i = 0; i < width; i++) {
        for (let c = 0; c < 3; c++) {
          fourier[c] += row[3 * i + c] * cosines[i];
          fourier[c + 3] += row[3 * i + c] * sines[i];
        }
      }
      for (let l = m; l < bands; l++) {
        const centre = l * l + l;
        for (let c = 0; c < 3; c++) {
          sum[3 * (centre + m) + c] += profile[centre + m] * fourier[c];
          if (m > 0) sum[3 * (centre - m) + c] += profile[centre + m] * fourier[c + 3];
        }
      }
    }
  }
  return sum;
}

/** Turns coefficients (three channels side by side) counter-clockwise about +z: only m and −m mix. */
export function rotateAboutZ(coefficients, bands, degrees) {
  const turned = Float64Array.from(coefficients.slice(0, 3 * bands * bands));
  for (let l = 1; l < bands; l++) {
    for (let m = 1; m <= l; m++) {
      const angle = (m * degrees * Math.PI) / 180;
      const cosine = Math.cos(angle), sine = Math.sin(angle);
      const plus = 3 * (l * l + l + m), minus = 3 * (l * l + l - m);
      for (let c = 0; c < 3; c++) {
        turned[plus + c] = cosine * coefficients[plus + c] - sine * coefficients[minus + c];
        turned[minus + c] = sine * coefficients[plus + c] + cosine * coefficients[minus + c];
      }
    }
  }
  return turned;
}

/** Applies a rotation given as one row-major block to a degree. */
export function applyBlocks(blocks, coefficients, bands) {
  const out = new Float64Array(3 * bands * bands);
  for (let l = 0; l < bands; l++) {
    const width = 2 * l + 1;
    for (let row = 0; row < width; row++) {
      for (let column = 0; column < width; column++) {
        const weight = blocks[l][row * width + column];
        for (let c = 0; c < 3; c++) {
          out[3 * (l * l + row) + c] += weight * coefficients[3 * (l * l + column) + c];
        }
      }
    }
  }
  return out;
}

/** A_l / π of the clamped cosine (Ramamoorthi and Hanrahan 2001): radiance of an open white surface by degree. */
export const OPEN_BY_DEGREE = [1, 2 / 3, 1 / 4, 0, -1 / 24, 0, 1 / 64, 0, -1 / 128, 0, 7 / 1536];

/** Radiance that leaves an open surface of albedo 1 with the given normal. */
export function openRadiance(coefficients, bands, normal) {
  const basis = evaluateBasis(bands, normal[0], normal[1], normal[2], new Float64Array(bands * bands));
  const out = [0, 0, 0];
  for (let l = 0; l < bands; l++) {
    for (let i = l * l; i < (l + 1) * (l + 1); i++) {
      for (let c = 0; c < 3; c++) out[c] += OPEN_BY_DEGREE[l] * basis[i] * coefficients[3 * i + c];
    }
  }
  return out;
}
