// Flight: the exact step of the vehicle, as in flatgym/quadrotor.py.
// x'' = f sin(theta), z'' = f cos(theta) - g, theta' = omega, for constant thrust f and rate omega.
"use strict";
const Flight = (() => {
  // Spherical Bessel functions j0(a) = sin a / a and j1(a) = (sin a - a cos a) / a^2. For small a the closed forms lose
  // digits, so series are used.
  function bessel(a) {
    const q = a * a;
    if (q >= 0.25) return [Math.sin(a) / a, (Math.sin(a) - a * Math.cos(a)) / q];
    return [
      1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110 * (1 - q / 156))))),
      a / 3 * (1 - q / 10 * (1 - q / 28 * (1 - q / 54 * (1 - q / 88)))),
    ];
  }

  // State [x, z, vx, vz, theta] after h seconds of constant control [thrust, rate].
  function exact([x, z, vx, vz, theta], [thrust, rate], h, gravity) {
    const a = rate * h / 2;
    const [j0, j1] = bessel(a);
    const [sin, cos] = [Math.sin(theta + a), Math.cos(theta + a)];
    const push = thrust * h * h / 2;
    return [
      x + vx * h + push * (j0 * sin - j1 * cos),
      z + vz * h + push * (j0 * cos + j1 * sin) - gravity * h * h / 2,
      vx + thrust * h * j0 * sin,
      vz + thrust * h * j0 * cos - gravity * h,
      theta + rate * h,
    ];
  }

  // State and control of an entry after `steps` environment steps, a real number. After its end it stays in place.
  function at(entry, steps, { dt, gravity }) {
    const n = entry.steps;
    if (steps >= n) return { state: entry.states[n], control: [0, 0], step: n, ended: true };
    const step = Math.floor(steps);
    const control = entry.controls[step];
    return { state: exact(entry.states[step], control, (steps - step) * dt, gravity), control, step, ended: false };
  }

  // Points [x, z] of the path up to then, several for each step.
  const POINTS_PER_STEP = 4;
  function path(entry, steps, world) {
    const last = Math.min(steps, entry.steps);
    const points = [];
    for (let i = 0; i < last * POINTS_PER_STEP; i += 1) points.push(at(entry, i / POINTS_PER_STEP, world).state);
    points.push(at(entry, last, world).state);
    return points;
  }

  return { exact, at, path };
})();
