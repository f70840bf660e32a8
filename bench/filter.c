/* The arithmetic of the filters `stateful` and `paper` (stateful_ahrs/filters/stateful.py), in C for
   comparison alone: the same steps in the same order, for samples of all three sensors. */
#include <math.h>

typedef struct { double w, x, y, z; } rotor;
typedef struct { double x, y, z; } vector;

static double dot(rotor p, rotor q) { return p.w * q.w + p.x * q.x + p.y * q.y + p.z * q.z; }

static rotor scaled(rotor q, double s) { return (rotor){q.w * s, q.x * s, q.y * s, q.z * s}; }

static rotor unit(rotor q) { return scaled(q, 1.0 / sqrt(dot(q, q))); }

static rotor product(rotor p, rotor q)
{
    return (rotor){p.w * q.w - p.x * q.x - p.y * q.y - p.z * q.z,
                   p.w * q.x + p.x * q.w + p.y * q.z - p.z * q.y,
                   p.w * q.y - p.x * q.z + p.y * q.w + p.z * q.x,
                   p.w * q.z + p.x * q.y - p.y * q.x + p.z * q.w};
}

static vector rotate(rotor q, vector v)
{
    double tx = 2.0 * (q.y * v.z - q.z * v.y);
    double ty = 2.0 * (q.z * v.x - q.x * v.z);
    double tz = 2.0 * (q.x * v.y - q.y * v.x);
    return (vector){v.x + q.w * tx + q.y * tz - q.z * ty,
                    v.y + q.w * ty + q.z * tx - q.x * tz,
                    v.z + q.w * tz + q.x * ty - q.y * tx};
}

static rotor from_rate(vector rate, double dt)
{
    double x = 0.5 * dt * rate.x, y = 0.5 * dt * rate.y, z = 0.5 * dt * rate.z;
    double square = x * x + y * y + z * z;
    if (square > 0.01) {
        double half = sqrt(square), s = sin(half) / half;
        return (rotor){cos(half), s * x, s * y, s * z};
    }
    return (rotor){1.0 - 0.5 * square, x, y, z};
}

/* dcm.py, eq. 5-10 */
static int dcm(vector a, vector m, rotor *q)
{
    double square = a.x * a.x + a.y * a.y + a.z * a.z;
    double field = m.x * m.x + m.y * m.y + m.z * m.z;
    if (!(1e-24 < square && square < 1e24 && 1e-24 < field && field < 1e24)) return 0;
    double cx = a.y * m.z - a.z * m.y, cy = a.z * m.x - a.x * m.z, cz = a.x * m.y - a.y * m.x;
    double across = cx * cx + cy * cy + cz * cz;
    if (!(across > 1e-6 * square * field)) return 0;
    double ra = sqrt(square), rc = sqrt(across), one = ra * rc;
    double mx = cy * a.z - cz * a.y, my = cz * a.x - cx * a.z, mz = cx * a.y - cy * a.x;
    cx *= ra, cy *= ra, cz *= ra;
    double ax = a.x * rc, ay = a.y * rc, az = a.z * rc;
    double d0 = one + mx + cy + az, d1 = one + mx - cy - az;
    double d2 = one - mx + cy - az, d3 = one - mx - cy + az;
    double largest = fmax(fmax(d0, d1), fmax(d2, d3));
    double s = 0.5 / sqrt(largest * one);
    if (largest == d0)
        *q = (rotor){s * d0, s * (ay - cz), s * (mz - ax), s * (cx - my)};
    else if (largest == d1)
        *q = (rotor){s * (ay - cz), s * d1, s * (cx + my), s * (mz + ax)};
    else if (largest == d2)
        *q = (rotor){s * (mz - ax), s * (cx + my), s * d2, s * (ay + cz)};
    else
        *q = (rotor){s * (cx - my), s * (mz + ax), s * (ay + cz), s * d3};
    return 1;
}

/* stateful.step and senses.look; the rows are those of `Samples`, the settings those of `Settings`.
   Rejected samples are not counted, which they need not be where all are good. */
void run(long n, double alpha, double alpha_rate, int normalise, int average_start,
         const double *gyro, const double *accel, const double *mag, const double *steps,
         double *rotors)
{
    const rotor identity = {1.0, 0.0, 0.0, 0.0};
    rotor state = identity;
    vector field = {1.0, 0.0, 0.0};
    double mag_age = INFINITY, elapsed = 0.0, paced = -1.0, pace = alpha;
    int started = 0, heading_known = 0;
    for (long i = 0; i < n; i++, gyro += 3, accel += 3, mag += 3, rotors += 4) {
        double dt = steps[i];
        rotor turn = from_rate((vector){gyro[0], gyro[1], gyro[2]}, dt);
        rotor predicted = product(state, turn), snapshot = identity;
        rotor back = {turn.w, -turn.x, -turn.y, -turn.z};
        vector up = {accel[0], accel[1], accel[2]}, new = {mag[0], mag[1], mag[2]};
        int starts = dt <= 0.0 || !started;
        heading_known = heading_known && dt > 0.0;
        field = rotate(back, field);
        mag_age = dt > 0.0 ? mag_age + dt : INFINITY;
        double size = new.x * new.x + new.y * new.y + new.z * new.z;
        int fresh = 1e-24 < size && size < 1e24, found = 0, from_mag = 0;
        double force = up.x * up.x + up.y * up.y + up.z * up.z;
        int has_up = 0.0025 < force && force < 1e8;
        if (has_up && (fresh || mag_age <= 0.5)) {
            vector level = up;
            if (!(starts || heading_known)) {
                rotor p = unit(predicted);
                level = rotate((rotor){p.w, -p.x, -p.y, -p.z}, (vector){0.0, 0.0, 1.0});
            }
            from_mag = dcm(level, fresh ? new : field, &snapshot);
            fresh = fresh && from_mag;
        }
        int begins = starts || (from_mag && !heading_known);
        if (fresh) field = new, mag_age = 0.0;
        found = from_mag;
        if (has_up && !found) {
            vector north = {1.0, 0.0, 0.0};
            if (started) {
                rotor p = unit(predicted);
                north = rotate((rotor){p.w, -p.x, -p.y, -p.z}, north);
            }
            found = dcm(up, north, &snapshot);
        }
        if (found && dot(snapshot, predicted) < 0.0) snapshot = scaled(snapshot, -1.0);
        rotor now = predicted;
        elapsed += dt;
        if (begins && found) {
            now = snapshot;
            if (starts) elapsed = 0.0;
        } else if (found) {
            if (alpha_rate > 0.0 && dt != paced) paced = dt, pace = pow(alpha, dt * alpha_rate);
            double weight = pace;
            if (average_start && elapsed < 1.0) weight = fmin(weight, elapsed / (elapsed + dt));
            double rest = 1.0 - weight;
            now = (rotor){weight * predicted.w + rest * snapshot.w,
                          weight * predicted.x + rest * snapshot.x,
                          weight * predicted.y + rest * snapshot.y,
                          weight * predicted.z + rest * snapshot.z};
        }
        if (normalise) now = unit(now);
        started = started || found;
        heading_known = heading_known || from_mag;
        state = now;
        rotor out = unit(now);
        rotors[0] = out.w, rotors[1] = out.x, rotors[2] = out.y, rotors[3] = out.z;
    }
}
