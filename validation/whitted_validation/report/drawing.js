// Turning pictures into colours on a canvas.

const HUES = { // of the verdict: equal, explained, unexplained
  light: [[222, 226, 220], [36, 99, 209], [208, 28, 38]],
  dark: [[52, 58, 60], [110, 160, 255], [255, 92, 92]],
};
// Black for no error, then from dark blue over magenta and orange to near white: lighter is worse.
const RAMP = [[20, 20, 54], [82, 28, 120], [168, 46, 110], [230, 92, 60], [250, 170, 70], [255, 250, 215]];

const MOST_RINGS = 60;

const isDark = () => matchMedia("(prefers-color-scheme: dark)").matches && !matchMedia("print").matches;

/** sRGB (IEC 61966-2-1) of linear radiance, 0..255; the canvas rounds. */
function coded(linear) {
  if (!(linear > 0)) return 0;
  if (linear >= 1) return 255;
  return 255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);
}

/** Colour of a share 0..1 of the error scale. */
function ramp(share) {
  const at = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const k = Math.min(Math.floor(at), RAMP.length - 2);
  return RAMP[k].map((from, c) => from + (at - k) * (RAMP[k + 1][c] - from));
}

/** The ends of the error scale as powers of ten: what float32 can show, up to the largest finite error that is equal. */
function scaleOf(pair, unit) {
  const errors = unit === "ulp" ? pair.worstUlps : pair.worst;
  let largest = 0;
  errors.forEach((error, i) => {
    if (Number.isFinite(error) && !pair.status?.[i] && error > largest) largest = error;
  });
  const [low, high] = unit === "ulp" ? [-1, 3] : [-9, -3];
  return [low, Math.max(high, Math.ceil(Math.log10(largest || 1e-300)))];
}

const makers = {
  /** A picture at an exposure in stops; what is no finite number shows as magenta. */
  light(planes, exposure) {
    const gain = 2 ** exposure;
    return (i) => {
      const rgb = planes.map((plane) => plane[i]);
      return rgb.every(Number.isFinite) ? rgb.map((x) => coded(gain * x)) : [255, 0, 255];
    };
  },
  error(pair, unit) {
    const errors = unit === "ulp" ? pair.worstUlps : pair.worst;
    const [low, high] = scaleOf(pair, unit);
    return (i) => {
      if (errors[i] === 0) return [0, 0, 0];
      return errors[i] === Infinity ? [255, 0, 255] : ramp((Math.log10(errors[i]) - low) / (high - low));
    };
  },
  /** Equal pixels show a pale A in grey, so that the others are seen in their place. */
  verdict(pair) {
    const hues = HUES[isDark() ? "dark" : "light"];
    return (i) => {
      const hue = hues[pair.status[i]];
      if (pair.status[i]) return hue;
      const grey = coded(0.2126 * pair.a[0][i] + 0.7152 * pair.a[1][i] + 0.0722 * pair.a[2][i]);
      return hue.map((x) => 0.7 * x + 0.3 * grey);
    };
  },
};

/** Paint all pixels onto a canvas of the picture's own size. */
function painted(width, height, colour) {
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d");
  const image = context.createImageData(width, height);
  for (let i = 0; i < width * height; i++) {
    const [r, g, b] = colour(i);
    image.data[4 * i] = r; image.data[4 * i + 1] = g; image.data[4 * i + 2] = b; image.data[4 * i + 3] = 255;
  }
  context.putImageData(image, 0, 0);
  return canvas;
}

/** A number as short as it can be read in a pixel. */
function brief(x) {
  if (Number.isNaN(x)) return "NaN";
  if (!Number.isFinite(x)) return x > 0 ? "∞" : "−∞";
  if (x === 0) return "0";
  const size = Math.abs(x);
  return (size >= 1e-3 && size < 1e4 ? String(Number(x.toPrecision(4))) : x.toExponential(2)).replace("-", "−");
}

/** Write the numbers of the pixels in sight into them. */
function writeNumbers(context, viewer) {
  const { pair, scale, left, top, view } = viewer;
  const [x0, y0] = [Math.max(0, Math.floor(left)), Math.max(0, Math.floor(top))];
  const x1 = Math.min(pair.width, Math.ceil(left + viewer.wide / scale));
  const y1 = Math.min(pair.height, Math.ceil(top + viewer.tall / scale));
  const size = Math.min(15, scale / 5);
  context.font = `${size}px ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", monospace`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  for (let y = y0; y < y1; y++) {
    for (let x = x0; x < x1; x++) {
      const i = y * pair.width + x;
      const lines = viewer.linesOf(i, x);
      const [r, g, b] = viewer.colourAt(i, x);
      context.fillStyle = 0.299 * r + 0.587 * g + 0.114 * b > 140 ? "#000" : "#fff";
      lines.forEach((line, k) => {
        const down = (k - (lines.length - 1) / 2) * 1.25 * size;
        context.fillText(line, (x + 0.5 - left) * scale, (y + 0.5 - top) * scale + down);
      });
    }
  }
}

/** Mark the pixels that are not equal: by rings where they are few and small, else by their outlines. */
function markUnequal(context, viewer) {
  const { pair, scale, left, top, marked } = viewer;
  const hues = HUES[isDark() ? "dark" : "light"];
  const rings = scale < 8 && marked.length <= MOST_RINGS;
  const strokes = rings || scale >= 8 ? [["#fffc", 4.5], [null, 2.5]] : [[null, 1]];
  const inset = strokes.length / 2;
  for (const i of marked) {
    const [x, y] = [(i % pair.width - left) * scale, (Math.floor(i / pair.width) - top) * scale];
    if (x < -scale || y < -scale || x > viewer.wide || y > viewer.tall) continue;
    context.beginPath();
    if (rings) context.arc(x + scale / 2, y + scale / 2, 7, 0, 2 * Math.PI);
    else context.rect(x + inset, y + inset, scale - 2 * inset, scale - 2 * inset);
    for (const [hue, wide] of strokes) {
      context.strokeStyle = hue ?? `rgb(${hues[pair.status[i]]})`;
      context.lineWidth = wide;
      context.stroke();
    }
  }
}

/** Outline the chosen pixel, so that it is seen on black and on white. */
function outline(context, viewer, i) {
  const { pair, scale, left, top } = viewer;
  const side = Math.max(scale, 5);
  const x = (i % pair.width + 0.5 - left) * scale - side / 2;
  const y = (Math.floor(i / pair.width) + 0.5 - top) * scale - side / 2;
  context.lineWidth = 3;
  context.strokeStyle = "#000";
  context.strokeRect(x, y, side, side);
  context.lineWidth = 1;
  context.strokeStyle = "#fff";
  context.strokeRect(x, y, side, side);
}

/** Draw the line between A and B. */
function drawLine(context, { tall }, line) {
  context.fillStyle = "#0008";
  context.fillRect(line - 1.5, 0, 3, tall);
  context.fillStyle = "#fff";
  context.fillRect(line - 0.5, 0, 1, tall);
  context.font = "600 13px system-ui, sans-serif";
  context.textBaseline = "top";
  for (const [text, at, align] of [["A", line - 9, "right"], ["B", line + 9, "left"]]) {
    context.textAlign = align;
    context.lineWidth = 3;
    context.strokeStyle = "#0009";
    context.strokeText(text, at, 8);
    context.fillText(text, at, 8);
  }
}

/** Draw the error scale below the picture. */
function drawScale(viewer) {
  const [low, high] = scaleOf(viewer.pair, viewer.unit);
  const unit = viewer.unit === "ulp" ? " ulp" : "";
  viewer.find(".low").textContent = `black: 0. 10^${low}${unit}`.replace("^-", "^−");
  viewer.find(".high").textContent = `10^${high}${unit} and more`.replace("^-", "^−");
  const context = viewer.find(".ramp").getContext("2d");
  for (let x = 0; x < 256; x++) {
    context.fillStyle = `rgb(${ramp(x / 255)})`;
    context.fillRect(x, 0, 1, 1);
  }
}
