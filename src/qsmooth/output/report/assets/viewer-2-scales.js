// Colours of values. Both maps rise evenly in lightness, so that they read in grey, too.

const COLOUR_MAPS = {
  viridis: ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"],
  cividis: ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#fee838"],
  greys: ["#1a1a1a", "#333333", "#4d4d4d", "#686868", "#848484", "#a0a0a0", "#bdbdbd", "#dbdbdb", "#f7f7f7"],
};
const N_BREAKS = 33; // of a scale by quantiles
const N_SAMPLED = 100000; // values at most that quantiles are taken from

function rgbOf(hex) {
  return [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
}

function colourAt(map, t) {
  const anchors = COLOUR_MAPS[map];
  const place = Math.min(Math.max(t, 0), 1) * (anchors.length - 1);
  const k = Math.min(Math.floor(place), anchors.length - 2);
  const low = rgbOf(anchors[k]), high = rgbOf(anchors[k + 1]);
  return low.map((channel, i) => Math.round(channel + (place - k) * (high[i] - channel)));
}

function cssColour(rgb) {
  return `rgb(${rgb.join(",")})`;
}

function finiteExtent(arrays) {
  let low = Infinity, high = -Infinity;
  for (const values of arrays) {
    for (let c = 0; c < values.length; c++) {
      const value = values[c];
      if (value < low && value !== -Infinity) low = value;
      if (value > high && value !== Infinity) high = value;
    }
  }
  return low <= high ? [low, high] : [0, 1];
}

function sampleOf(arrays) {
  const total = arrays.reduce((sum, values) => sum + values.length, 0);
  const stride = Math.max(1, Math.ceil(total / N_SAMPLED));
  const sample = [];
  for (const values of arrays) {
    for (let c = 0; c < values.length; c += stride) {
      if (Number.isFinite(values[c])) sample.push(values[c]);
    }
  }
  return Float64Array.from(sample).sort();
}

function quantilesOf(sample, n) {
  if (!sample.length) return new Float32Array(n);
  return Float32Array.from({ length: n }, (_, k) => {
    const place = (k / (n - 1)) * (sample.length - 1);
    const low = Math.floor(place), high = Math.ceil(place);
    return sample[low] + (place - low) * (sample[high] - sample[low]);
  });
}

// From values to 0 (the map's dark end) .. 1. Unless turned round, dark is where cells are bad.
class Scale {
  constructor(metric, arrays, choice) {
    this.metric = metric;
    this.map = choice.map;
    this.extent = finiteExtent(arrays);
    this.byQuantiles = choice.scale === "quantiles";
    const [low, high] = metric.range || this.tamed(arrays);
    this.low = Number.isFinite(choice.low) ? choice.low : low;
    this.high = Number.isFinite(choice.high) ? choice.high : high;
    if (!(this.high > this.low)) this.high = this.low + (Math.abs(this.low) || 1) * 1e-6;
    this.logarithmic = Boolean(metric.log) && this.low > 0;
    this.flipped = (metric.better === "lower") !== choice.reverse;
    this.breaks = this.byQuantiles
      ? quantilesOf(sampleOf(arrays), N_BREAKS)
      : new Float32Array(N_BREAKS);
  }

  // One cell of 1e9 must not take all colours of a metric without an end.
  tamed(arrays) {
    const [low, high] = this.extent;
    const quantiles = quantilesOf(sampleOf(arrays), 101);
    const usual = quantiles[99] - quantiles[1];
    return [Math.max(low, quantiles[1] - 3 * usual), Math.min(high, quantiles[99] + 3 * usual)];
  }

  // 0 .. 1 along the legend, low values first.
  share(value) {
    if (this.byQuantiles) return this.rank(value);
    const t = this.logarithmic
      ? Math.log(value / this.low) / Math.log(this.high / this.low)
      : (value - this.low) / (this.high - this.low);
    return Math.min(Math.max(t, 0), 1);
  }

  rank(value) {
    let low = 0, high = N_BREAKS - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (value >= this.breaks[middle]) low = middle;
      else high = middle;
    }
    const width = this.breaks[high] - this.breaks[low];
    const inside = width > 0 ? (value - this.breaks[low]) / width : value > this.breaks[low] ? 1 : 0;
    return (low + Math.min(Math.max(inside, 0), 1)) / (N_BREAKS - 1);
  }

  valueAt(share) {
    if (this.byQuantiles) {
      const place = share * (N_BREAKS - 1), k = Math.min(Math.floor(place), N_BREAKS - 2);
      return this.breaks[k] + (place - k) * (this.breaks[k + 1] - this.breaks[k]);
    }
    if (this.logarithmic) return this.low * (this.high / this.low) ** share;
    return this.low + share * (this.high - this.low);
  }

  colourOfShare(share) {
    return colourAt(this.map, this.flipped ? 1 - share : share);
  }

  colour(value) {
    return this.colourOfShare(this.share(value));
  }
}

// Bins of a histogram over all that is finite; one more at the end for what is infinite.
class Bins {
  constructor(metric, arrays, n) {
    const extent = finiteExtent(arrays);
    const [low, high] = metric.range || extent;
    this.low = Math.min(low, extent[0]);
    this.high = Math.max(high, extent[1]);
    this.logarithmic = Boolean(metric.log) && this.low > 0 && this.high > 20 * this.low;
    if (!(this.high > this.low)) this.high = this.low + (Math.abs(this.low) || 1) * 1e-3;
    this.n = n;
    this.counts = arrays.map((values) => this.count(values));
    this.hasInfinite = this.counts.some((counts) => counts[n] > 0);
  }

  count(values) {
    const { n, low, logarithmic } = this;
    const counts = new Uint32Array(n + 1);
    const factor = n / (logarithmic ? Math.log(this.high / low) : this.high - low);
    for (let c = 0; c < values.length; c++) {
      const value = values[c];
      if (value === Infinity) counts[n]++;
      else {
        const place = (logarithmic ? Math.log(value / low) : value - low) * factor;
        if (place >= 0) counts[Math.min(Math.floor(place), n - 1)]++;
      }
    }
    return counts;
  }

  // The low end of a bin; `edge(n)` is the end of the last one.
  edge(k) {
    if (k > this.n) return Infinity;
    const share = k / this.n;
    return this.logarithmic
      ? this.low * (this.high / this.low) ** share
      : this.low + share * (this.high - this.low);
  }
}

function formatted(value, metric) {
  if (value === undefined || value === null || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  const unit = metric && metric.unit ? (metric.unit === "°" ? "°" : ` ${metric.unit}`) : "";
  return plain(value, unit === "°") + unit;
}

function plain(value, isAngle) {
  if (isAngle) return value.toFixed(Math.abs(value) < 1 ? 2 : 1).replace("-", "−");
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e6)) return value.toExponential(2).replace("-", "−");
  return String(Number(value.toPrecision(4))).replace("-", "−");
}

function counted(n) {
  return n.toLocaleString("en-GB");
}
