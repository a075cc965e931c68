/** Principal axes of a spread in the plane. */

/** Standard deviations along the principal axes [m], and the turn of the longer one against x [rad]. */
interface PrincipalAxes {
  readonly long: number;
  readonly short: number;
  readonly turn: number;
}

/** Returns the principal axes of a covariance [[xx, xy], [xy, yy]] [m²]; null where it is none. */
export function principalAxes(xx: number, xy: number, yy: number): PrincipalAxes | null {
  const [middle, apart] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
  if (!(middle + apart > 0) || !(middle - apart > -ROUNDING * middle)) return null;
  return { long: Math.sqrt(middle + apart), short: Math.sqrt(Math.max(0, middle - apart)), turn: 0.5 * Math.atan2(2 * xy, xx - yy) };
}

const ROUNDING = 1e-9; // of the variance: a spread along one line has no width
