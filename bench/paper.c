/* The arithmetic of the filter `paper` (stateful_ahrs/filters/stateful.py), in C for comparison
   alone: the same steps in the same order, for samples of all three sensors. */
#include "rotor.h"

/* stateful.step and senses.look; the rows are those of `Samples`, the settings those of `Settings`.
   Rejected samples are not counted, which they need not be where all are good. */
void run(long n, double alpha, double alpha_rate, const double *gyro, const double *accel,
         const double *mag, const double *steps, double *rotors)
{
    Rotor state = IDENTITY;
    Vector field = NORTH;
    const Gains chosen = gains(alpha, alpha_rate);
    double mag_age = INFINITY, paced = -INFINITY, pace = alpha;
    int started = 0, heading_known = 0;
    for (long i = 0; i < n; i++, gyro += 3, accel += 3, mag += 3, rotors += 4) {
        double dt = steps[i];
        Rotor turn = from_rate((Vector){gyro[0], gyro[1], gyro[2]}, dt);
        Rotor predicted = product(state, turn), snapshot = IDENTITY;
        Vector up = {accel[0], accel[1], accel[2]}, new = {mag[0], mag[1], mag[2]};
        int starts = dt <= 0.0 || !started;
        heading_known = heading_known && dt > 0.0;
        field = carried(turn, field);
        mag_age = dt > 0.0 ? mag_age + dt : INFINITY;
        int fresh = heard(new), has_up = usable(up), found = 0, from_mag = 0;
        if (has_up && (fresh || mag_age <= MAG_TIMEOUT)) {
            Vector level = starts || heading_known ? up : carried(unit(predicted), UP);
            from_mag = dcm(level, fresh ? new : field, &snapshot);
            fresh = fresh && from_mag;
        }
        int begins = starts || (from_mag && !heading_known);
        if (fresh) field = new, mag_age = 0.0;
        found = from_mag;
        if (has_up && !found)
            found = dcm(up, started ? carried(unit(predicted), NORTH) : NORTH, &snapshot);
        if (found && dot(snapshot, predicted) < 0.0) snapshot = scaled(snapshot, -1.0);
        Rotor now = predicted;
        if (begins && found) {
            now = snapshot;
        } else if (found) {
            if (dt != paced) pace = paced_weight(chosen, paced, pace, dt), paced = dt;
            double rest = 1.0 - pace;
            now = (Rotor){pace * predicted.w + rest * snapshot.w,
                          pace * predicted.x + rest * snapshot.x,
                          pace * predicted.y + rest * snapshot.y,
                          pace * predicted.z + rest * snapshot.z};
        }
        started = started || found;
        heading_known = heading_known || from_mag;
        state = now;
        Rotor out = unit(now);
        rotors[0] = out.w, rotors[1] = out.x, rotors[2] = out.y, rotors[3] = out.z;
    }
}
