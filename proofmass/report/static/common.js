// Functions of all pages: finding elements, formatting numbers, arrays from base64, copying.
"use strict";

const find = (selector, inside = document) => inside.querySelector(selector);
const findAll = (selector, inside = document) => [...inside.querySelectorAll(selector)];

const MINUS = "\u2212";
const ENTITIES = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" };

function escaped(text) {
  return String(text).replace(/[&<>"]/g, (letter) => ENTITIES[letter]);
}

// Format a number with significant digits: 1.1e−15, 0.023, 412; a dash for none.
function worded(value, digits = 2) {
  if (value === null || value === undefined || !Number.isFinite(value)) {
    return "–";
  }
  if (value === 0) {
    return "0";
  }
  const size = Math.abs(value);
  if (size >= 1e-2 && size < 1e5) {
    const whole = size >= 100 ? Math.max(digits, 3) : digits;
    return String(Number(value.toPrecision(whole))).replace("-", MINUS);
  }
  const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
  const short = mantissa.includes(".") ? mantissa.replace(/0+$/, "").replace(/\.$/, "") : mantissa;
  return `${short}e${Number(exponent)}`.replaceAll("-", MINUS);
}

// Format words as a list: a, b and c.
function formatList(words) {
  return [words.slice(0, -1).join(", "), ...words.slice(-1)].filter(Boolean).join(" and ");
}

const ARRAYS = { f8: Float64Array, f4: Float32Array, i2: Int16Array, u1: Uint8Array };

// An array from base64; its numbers are little-endian, as on all machines that browsers run on.
function unpacked(text, kind) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new ARRAYS[kind](bytes.buffer);
}

// The present value of a variable of the style sheet, such as a colour, which differs in the dark.
function variable(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// The index of the entry of a rising array that is nearest to a value.
function nearest(values, wanted) {
  let low = 0;
  let high = values.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (values[middle] < wanted) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return Math.abs(values[low] - wanted) <= Math.abs(values[high] - wanted) ? low : high;
}

// Copy a text; the button says so for a moment.  Pages from disk may lack the clipboard's interface.
async function copyText(text, button) {
  const before = button?.textContent;
  let done = true;
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    done = copySelected(text);
  }
  if (button) {
    button.textContent = done ? "Copied" : "Not copied";
    setTimeout(() => {
      button.textContent = before;
    }, 1500);
  }
  return done;
}

function copySelected(text) {
  const area = document.createElement("textarea");
  area.value = text;
  document.body.append(area);
  area.select();
  const done = document.execCommand("copy");
  area.remove();
  return done;
}
