// Format numbers and names.

export const MISSING = "–";

export function rate(hz) {
  if (hz === null || hz === undefined) return MISSING;
  return hz >= 100 ? hz.toFixed(0) : hz.toPrecision(3);
}

export function milliseconds(seconds) {
  if (seconds === null || seconds === undefined) return MISSING;
  const value = seconds * 1e3;
  return Math.abs(value) >= 100 ? value.toFixed(0) : value.toFixed(2);
}

export function number(value) {
  if (value === null || value === undefined) return MISSING;
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e5 || size < 1e-3 ? value.toExponential(2) : value.toPrecision(4);
}

export function clock(seconds) {
  const whole = Math.floor(seconds);
  const two = (part) => String(part).padStart(2, "0");
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  return hours ? `${hours}:${two(minutes)}:${two(whole % 60)}` : `${minutes}:${two(whole % 60)}`;
}

// `/ns/obelisk_control_0` -> `control_0`, a name that commands accept, too.
export function shortNode(name) {
  return name.split("/").pop().replace(/^obelisk_/, "");
}

// The common namespace of all names, with a trailing slash; empty if there is none.
export function commonSpace(names) {
  const spaces = names.map((name) => name.split("/").slice(0, -1));
  const first = spaces[0] ?? [];
  const differs = first.findIndex((part, place) => spaces.some((one) => one[place] !== part));
  const common = differs < 0 ? first : first.slice(0, differs);
  return common.length > 1 ? `${common.join("/")}/` : "";
}
