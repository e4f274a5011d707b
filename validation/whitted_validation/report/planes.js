"use strict";
// Planes of 32-bit words, as viewer.py packs them.

/** Inflate base64 (zlib) to bytes. */
async function inflated(text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Undo what viewer.py's `_packed` did: bytes in their places, sign, then differences. */
async function unpacked([way, text], width, like) {
  const bytes = await inflated(text);
  const count = bytes.length / 4;
  const words = new Int32Array(count);
  for (let i = 0; i < count; i++) {
    const folded = bytes[i] | (bytes[count + i] << 8) | (bytes[2 * count + i] << 16) | (bytes[3 * count + i] << 24);
    words[i] = (folded >>> 1) ^ -(folded & 1);
  }
  if (way === "smooth") {
    for (let i = 0; i < count; i++) if (i % width) words[i] += words[i - 1];
    for (let i = width; i < count; i++) words[i] += words[i - width];
  } else if (way === "like") {
    for (let i = 0; i < count; i++) words[i] += like[i];
  }
  return words;
}

const asFloats = (words) => new Float32Array(words.buffer);

/** Spacing of float32 at x: the unit in the last place; below the least normal number that number's. */
function spacing(x) {
  const size = Math.max(Math.abs(Math.fround(x)), 2 ** -126);
  if (!Number.isFinite(size)) return NaN;
  let power = Math.floor(Math.log2(size));
  if (2 ** power > size) power -= 1;
  else if (2 ** (power + 1) <= size) power += 1;
  return 2 ** (power - 23);
}

/** Everything that is known of a pair of pictures. */
class Pair {
  static async from(data) {
    const pair = new Pair();
    const { width, height, planes } = data;
    Object.assign(pair, { width, height, of: data.of, step: data.step, names: data.names, told: data.told });
    pair.a = []; pair.b = []; pair.bound = []; pair.tail = [];
    for (let c = 0; c < 3; c++) {
      const a = await unpacked(planes["a" + c], width);
      pair.a.push(asFloats(a));
      pair.b.push(asFloats(await unpacked(planes["b" + c], width, a)));
      pair.tail.push(planes["tail" + c] ? await unpacked(planes["tail" + c], width) : null);
      if (planes["bound" + c]) pair.bound.push(asFloats(await unpacked(planes["bound" + c], width)));
    }
    for (const name of ["status", "x", "y"]) pair[name] = planes[name] ? await unpacked(planes[name], width) : null;
    pair.numbers = {};
    for (const [name, plane] of Object.entries(data.numbers)) pair.numbers[name] = await unpacked(plane, width);
    pair.labels = {};
    for (const [name, { plane, texts }] of Object.entries(data.labels)) {
      const list = JSON.parse(new TextDecoder().decode(await inflated(texts)));
      pair.labels[name] = { plane: await unpacked(plane, width), texts: list };
    }
    pair.explained = data.explained ? JSON.parse(new TextDecoder().decode(await inflated(data.explained))) : {};
    pair.measure();
    return pair;
  }

  /** B as the double that is nearest to what is known of it. */
  exact(i, c) {
    const b = this.b[c][i];
    return this.tail[c] ? b + (this.tail[c][i] / 8) * spacing(b) : b;
  }

  /** |A - B| of one channel; equal infinities do not differ. */
  error(i, c) {
    const [a, b] = [this.a[c][i], this.exact(i, c)];
    return Object.is(a, b) ? 0 : Math.abs(a - b);
  }

  /** The same in units of float32's spacing at B. */
  ulps(i, c) {
    const error = this.error(i, c);
    return error === 0 ? 0 : error / spacing(this.b[c][i]);
  }

  /** Keep each pixel's largest error; NaN counts as infinite. */
  measure() {
    const count = this.width * this.height;
    this.worst = new Float64Array(count);
    this.worstUlps = new Float64Array(count);
    for (let i = 0; i < count; i++) {
      for (let c = 0; c < 3; c++) {
        const error = this.error(i, c), ulps = this.ulps(i, c);
        this.worst[i] = Math.max(this.worst[i], Number.isNaN(error) ? Infinity : error);
        this.worstUlps[i] = Math.max(this.worstUlps[i], Number.isNaN(ulps) ? Infinity : ulps);
      }
    }
  }

  /** Coordinates of a pixel in the whole picture. */
  place(i) {
    return this.x ? [this.x[i], this.y[i]] : [i % this.width, Math.floor(i / this.width)];
  }

  /** Pixels that come with an explanation. */
  drawn() {
    return [...this.worst.keys()].filter((i) => this.place(i).join(",") in this.explained);
  }

  /** Pixels to look at first: not equal, unexplained before explained, then by error; without a verdict the worst. */
  listed(most) {
    const found = [];
    for (let i = 0; i < this.worst.length; i++) {
      if (this.status ? this.status[i] > 0 : this.worst[i] > 0) found.push(i);
    }
    const rank = (i) => (this.status ? this.status[i] : 0);
    return found.sort((i, j) => rank(j) - rank(i) || this.worst[j] - this.worst[i] || i - j).slice(0, most);
  }
}
