// The numbers of the page, as they are packed in it.

function bytesOf(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
  return bytes;
}

// Little-endian, as all machines with a browser are.
const shortsOf = (text) => new Uint16Array(bytesOf(text).buffer);
const floatsOf = (text) => new Float32Array(bytesOf(text).buffer);

// A colour of the style sheet, by the name of its variable, and one that is written as #rrggbb:
// three shares of 1.
const rgbOf = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
const styleColour = (name) => rgbOf(getComputedStyle(document.documentElement).getPropertyValue(name).trim());

// Viridis at five places (van der Walt and Smith 2015): told apart by most eyes, and in grey.
const RAMP = ["#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"];
const RAMP_RGB = RAMP.map(rgbOf);

// Three numbers up to 255.
function rampAt(share) {
  const at = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const k = Math.min(Math.floor(at), RAMP.length - 2);
  return mixed(RAMP_RGB[k], RAMP_RGB[k + 1], at - k).map((part) => 255 * part);
}
