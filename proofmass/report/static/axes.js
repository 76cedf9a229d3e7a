// Functions of all charts of studies: elements of SVG, logarithmic scales, and their ticks.
"use strict";

const SVG = "http://www.w3.org/2000/svg";

function element(name, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) {
    made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

function scale(low, high, from, to) {
  const [first, last] = [Math.log10(low), Math.log10(high)];
  return {
    place: (value) => from + ((Math.log10(value) - first) / (last - first)) * (to - from),
    value: (place) => 10 ** (first + ((place - from) / (to - from)) * (last - first)),
  };
}

// Ticks of a logarithmic axis: powers of ten, with 2 and 5 where there are fewer than three powers,
// or multiples of a round step where these are fewer than two ticks.
function ticks(low, high, most) {
  const first = Math.ceil(Math.log10(low) - 1e-9);
  const last = Math.floor(Math.log10(high) + 1e-9);
  const step = Math.max(1, Math.ceil((last - first) / most));
  const found = [];
  for (let power = first - 1; power <= last; power += 1) {
    const steps = last - first < 2 ? [1, 2, 5] : (last - power) % step === 0 ? [1] : [];
    found.push(...steps.map((digit) => digit * 10 ** power));
  }
  const inside = found.filter((value) => value >= low * 0.999 && value <= high * 1.001);
  return inside.length < 2 && low > 0 ? roundSteps(low, high, most) : inside;
}

// Multiples of a round step between two values that are near each other.
function roundSteps(low, high, most) {
  const least = (high - low) / Math.max(2, most - 1);
  const power = 10 ** Math.floor(Math.log10(least));
  const step = power * [1, 2, 5, 10].find((digit) => digit * power >= least * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high * 1.0001; k += 1) {
    found.push(Number((k * step).toPrecision(12)));
  }
  return found;
}

const TIMES = [
  [1, "s"],
  [1e-3, "ms"],
  [1e-6, "µs"],
];

// Format a time in seconds, in a suitable unit.
function timeWords(value, digits = 2) {
  const [size, unit] = TIMES.find(([least]) => value >= least * 0.999) ?? TIMES.at(-1);
  return `${worded(value / size, digits)} ${unit}`;
}
