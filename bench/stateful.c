/* The arithmetic of the filter `stateful` with its default settings (stateful_ahrs/filters), in C
   for comparison alone: the same steps in the same order under the same names, for samples of all
   three sensors (so no field has to be carried over a gap). */
#include "learning.h"

/* gains.py */
static const double START_LOW_PASSED = 2.0, AVERAGED = 4.0; /* LOW_PASS and twice that, s */
static const double NEWER = 3.0;

typedef struct { double dt, weight; } Pace;

static Pace paced(Gains gains, Pace last, double dt)
{
    return (Pace){dt, paced_weight(gains, last.dt, last.weight, dt)};
}

static inline double at_start(double weight, double elapsed, double dt)
{
    if (elapsed + dt < START_LOW_PASSED) return 0.0;
    return elapsed + dt < AVERAGED ? smaller(weight, elapsed / (elapsed + dt)) : weight;
}

static inline double part_of_heading(const Learned *learned, Pace pace, double elapsed,
                                     double span)
{
    if (elapsed < START_LOW_PASSED)
        return smaller(1.0, learned->trust * NEWER * span / elapsed);
    return smaller(1.0, span * smaller(learned->heading_rate, (1.0 - pace.weight) / pace.dt));
}

/* spikes.py */
static const double JUMP_OF_RATE = 4.0; /* rad/s */
static const double JUMP_OF_FORCE = 30.0, JUMP_AT_START = 6.0; /* m/s^2 */
static const double ALIKE = 1.0 / 16.0; /* of the square of the jump */
static const double SHORT = 0.022, STAYS = 0.25, SELDOM = 1.0; /* s */
static const double BETTER = 0.25; /* of a misfit */
static const double ABRUPT = 400.0; /* rad/s^2 */
static const double AGREEING = 0.97029572627599647; /* cos 14 degrees */
static const double FOURFOLD = 4.0; /* of the square of a field */
static const double CHANGE = 20.0; /* rad/s^2 */

/* The rate before the last, the time that the last turned for (negative where the mean of both did),
   the last force, the one before, the field before the last (earth frame), and the time since
   samples last jumped (0 where the last one was the first to). */
typedef struct {
    Vector rate;
    double span;
    Vector force, force_before, field;
    double jumped;
} Seen;

static inline int is_rare(const Seen *seen)
{
    return seen->jumped == 0.0 || seen->jumped >= SELDOM;
}

/* How far off a force may be a glitch, where means are of so long. */
static inline double jump_of_force(double elapsed)
{
    return elapsed < START_LOW_PASSED ? JUMP_AT_START : JUMP_OF_FORCE;
}

static Vector middle(Vector u, Vector v) { return times(0.5, total(u, v)); }

static int is_far(Vector u, Vector v, double jump) { return square(minus(u, v)) > jump * jump; }

/* The rate in a gap, by those at its ends: if too far apart, the latter may be none. */
static Vector over_gap(Vector before, Vector after, double span)
{
    return is_far(before, after, JUMP_OF_RATE + CHANGE * span) ? before : middle(before, after);
}

/* Neither the least nor the largest. */
static double of_three(double a, double b, double c)
{
    return larger(smaller(a, b), smaller(larger(a, b), c));
}

/* What the last vector was if one of the three may be none. */
static Vector likely(Vector before, Vector last, Vector after)
{
    if (square(minus(after, before)) > square(minus(last, before))) return last;
    return (Vector){of_three(before.x, last.x, after.x), of_three(before.y, last.y, after.y),
                    of_three(before.z, last.z, after.z)};
}

static Vector shorter(Vector u, Vector v) { return square(u) < square(v) ? u : v; }

/* From the last vector to the mean of its neighbours if they agree without it; else zero. */
static Vector to_neighbours(Vector last, Vector before, Vector after, double jump)
{
    Vector one = minus(before, last), other = minus(after, last);
    double far = smaller(square(one), square(other));
    if (!(far > jump * jump && square(minus(one, other)) <= ALIKE * far)) return ZERO;
    return times(0.5, total(one, other));
}

/* What takes back the last turn, whose rate was `knock` off. */
static Rotor way_back(Vector last, const Seen *seen, Vector knock)
{
    Vector meant = total(last, knock);
    double span = seen->span;
    if (span < 0.0)
        span = -span, last = middle(seen->rate, last), meant = middle(seen->rate, meant);
    return product(conjugate(from_rate(last, span)), from_rate(meant, span));
}

/* Whether no motion comes and goes so in two steps: of a rate that is `knock` off. */
static int is_abrupt(Vector knock, double dt, const Seen *seen)
{
    double longest = larger(dt, fabs(seen->span));
    return longest < SHORT || square(knock) > squared(ABRUPT * longest);
}

/* Variance of the last turn, as its rate may have been `knock` off. */
static double variance_doubted(const Seen *seen, Vector knock)
{
    double span = seen->span < 0.0 ? 0.5 * seen->span : seen->span;
    return span * span * square(knock);
}

/* How far up and `field` are off by a rotor: 1 - cos of both, 0 for what is not there. */
static double misfit(Rotor rotor, Vector accel, Vector mag, Vector field)
{
    double found = 0.0;
    if (usable(accel)) {
        Vector up = rotate(rotor, accel);
        found += 1.0 - up.z / sqrt(square(up));
    }
    if (heard(mag) && heard(field)) {
        Vector m = rotate(rotor, mag);
        double along = m.x * field.x + m.y * field.y + m.z * field.z;
        found += 1.0 - along / sqrt(square(m) * square(field));
    }
    return found;
}

/* Whether gravity and field are much nearer to where they were by `rotor`. */
static int is_better(Rotor rotor, Rotor other, Vector accel, Vector mag, Vector field)
{
    return misfit(rotor, accel, mag, field) < BETTER * misfit(other, accel, mag, field);
}

/* Whether gravity shows that the start was none; not three times in a row. */
static int contradicts(Rotor rotor, const Seen *seen, Vector accel)
{
    return square(seen->force_before) == 0.0 && usable(accel)
        && rotate(rotor, accel).z < AGREEING * sqrt(square(accel));
}

/* A mean of forces over `time` without the last one, if that was none; for how long it counted. */
static double put_right(Vector *mean, double time, Rotor rotor, Rotor turn, const Seen *seen,
                        Vector accel, double jump)
{
    if (!(usable(seen->force) && usable(accel) && seen->span > 0.0)) return 0.0;
    Vector after = rotate(turn, accel);
    Vector knock = to_neighbours(seen->force, seen->force_before, after, jump);
    if (square(seen->force_before) == 0.0 && square(knock) > 0.0)
        knock = minus(after, seen->force); /* the first after a start */
    else if (square(knock) == 0.0 || !usable(seen->force_before))
        return 0.0;
    *mean = total(*mean, times(seen->span / time, rotate(rotor, knock)));
    return seen->span;
}

/* Whether a field differs by more than itself from a last good one, `age` s old; no if none. */
static inline int is_glitch(Vector mag, Vector last, double age, double dt)
{
    if (square(last) == 0.0 || age - dt >= SELDOM || dt >= STAYS) return 0;
    return square(minus(mag, last)) > smaller(square(mag), square(last));
}

/* Whether a field is twice or half as strong as a last good one, `age` s old; no if none. */
static inline int is_other(Vector mag, Vector last, double age, double dt)
{
    double strength = square(mag), usual = square(last);
    return age - dt < SELDOM && larger(strength, usual) > FOURFOLD * smaller(strength, usual);
}

/* gaps.py */
static const double GAP = 0.03, MISSING = 3.0, OF_RATE = 0.3, AT_REST = 0.1, SURE = 0.05;
static const double OF_CHANGE = 0.4, PER_SECOND = 1.5, MUCH_LOST = 0.003, ALL_LOST = 0.25;
static const double OFTEN = 1.0, COUNTS = 0.1; /* s */

static inline int is_gap(double dt, double last)
{
    return dt > GAP && dt > MISSING * last && last > 0.0;
}

/* Variance of a turn that took `span` s, by the rates before and after it. */
static double variance_lost(Vector before, Vector after, double span)
{
    return squared(span * (OF_RATE * sqrt(0.5 * (square(before) + square(after))) + AT_REST));
}

/* The same where one of the rates may be bad: what it does not know, their difference tells. */
static double variance_over_gap(Vector before, Vector after, double span)
{
    double of_change = span * smaller(OF_CHANGE, PER_SECOND * span);
    return variance_lost(before, after, span)
         + squared(of_change) * square(minus(after, before));
}

/* What a mean over `time` s is still worth after a turn of this variance. */
static double left_of(double time, double lost) { return time / (1.0 + time * lost / SURE); }

/* correction.py */
static const double NEARLY_UPRIGHT = 0.01, FAR = 0.999, NEARLY_NORTH = 0.9, MUCH = 0.9;
static const double UPSIDE_DOWN = 1e-3;
static const double FAR_OFF = 0.86602540378443865; /* cos 30 degrees */
static const int FIRST_HEADING = 3, ASKED = 4, DOUBTED = 5;

typedef struct {
    Vector rate, mag; /* the last good ones */
    double mag_age;
    int started, heading_known, turned;
    long sign_corrections, gyro_rejected, accel_rejected, mag_rejected;
} Senses;

/* The mean specific force, the time that went into it, the last magnetic field. */
typedef struct { Vector up; double time; Vector field; } Earth;

/* `rotate` by a rotor that is nearly one. */
static inline Vector slightly(Rotor q, Vector v)
{
    if (!(0.99999 < q.w && q.w < 1.00001)) return rotate(unit(q), v);
    return total(v, cross((Vector){2.0 * q.x, 2.0 * q.y, 2.0 * q.z}, v));
}

/* `1 - part + part d`, where d is the shortest turn from `up` to the vertical. */
static inline Rotor uprighted(Vector up, double part)
{
    double level = up.x * up.x + up.y * up.y;
    if (up.z > WEAKEST && level < NEARLY_UPRIGHT * up.z * up.z) {
        double s = 0.5 / up.z, q = s * s * level;
        double series = 1.0 - q * (1.5 - 3.875 * q);
        s *= part;
        return (Rotor){1.0 - part * q * (0.5 - 1.375 * q), s * up.y * series, -s * up.x * series,
                       0.0};
    }
    double length = sqrt(level + up.z * up.z);
    if (!(length > WEAKEST)) return IDENTITY;
    up.z += length; /* half way from it to the vertical */
    if (!(up.z > UPSIDE_DOWN * length)) up = (Vector){0.0, length, 0.0};
    double s = part / sqrt(square(up));
    return (Rotor){1.0 - part + s * up.z, s * up.y, -s * up.x, 0.0};
}

/* Cosine and sine of half the turn by `part` to a north that may be opposite. */
static void far_north(double north, double west, double part, double *cosine, double *sine)
{
    double c = 0.5 * (1.0 + north), s = -0.5 * west, size = c * c + s * s;
    if (size < 1e-12) {
        c = 0.0, s = 1.0;
    } else {
        double scale = 1.0 / sqrt(size);
        c *= scale, s *= scale;
    }
    c = 1.0 - part * (1.0 - c), s *= part;
    double scale = 1.0 / sqrt(c * c + s * s);
    *cosine = scale * c, *sine = scale * s;
}

/* `change`, and after it `part` of the turn from a measured north, level and of length one. */
static inline Rotor turned_north(Rotor change, double north, double west, double part)
{
    double cosine, sine;
    if (north < NEARLY_NORTH) {
        far_north(north, west, part, &cosine, &sine);
    } else {
        cosine = 1.0 - 0.5 * part * (1.0 - north), sine = -0.5 * part * west;
        double size = cosine * cosine + sine * sine;
        if (size < FAR) {
            double s = 1.0 / sqrt(size);
            cosine *= s, sine *= s;
        }
    }
    return (Rotor){cosine * change.w, cosine * change.x - sine * change.y,
                   cosine * change.y + sine * change.x, sine * change.w};
}

/* Take a sample after the start; returns the turn of `predicted`, and whether heading is told anew,
   by the first field or after a start that was far off. */
static inline Rotor corrected(Senses *senses, Earth *earth, const Learned *learned, Vector accel,
                              Vector mag, Rotor predicted, Vector nudge, Pace pace, double weight,
                              double elapsed, int *anew)
{
    double dt = pace.dt;
    if (usable(accel)) {
        earth->time = smaller(earth->time, LOW_PASS) + dt;
        double share = dt / earth->time;
        Vector off = minus(rotate(predicted, accel), earth->up);
        earth->up = total(earth->up, times(share, off));
    } else {
        senses->accel_rejected++;
    }
    Rotor change = uprighted(earth->up, 1.0 - weight);

    senses->mag_age += dt;
    int fresh = heard(mag), moved = weight < MUCH;
    if (fresh) {
        Vector found = rotate(predicted, mag), field = found;
        if (moved) /* then level is where up is now, not where it was predicted */
            field = slightly(change, field);
        double level = field.x * field.x + field.y * field.y;
        fresh = level > LEVEL * LEVEL * (level + field.z * field.z) /* else it is along gravity */
             && !is_glitch(found, earth->field, senses->mag_age, dt);
        if (fresh) {
            double length = sqrt(level), north = field.x / length, west = field.y / length;
            *anew = senses->heading_known <= 0;
            if (*anew) {
                moved = 1, senses->heading_known += FIRST_HEADING;
                change = turned_north(IDENTITY, north, west, 1.0);
            } else {
                double span = larger(dt, smaller(senses->mag_age, MAG_TIMEOUT));
                double part = part_of_heading(learned, pace, elapsed, span);
                moved |= part > 1.0 - MUCH;
                *anew = elapsed < START_LOW_PASSED && part > 0.5 && north < FAR_OFF;
                change = turned_north(change, north, west, part);
            }
            senses->mag = mag, senses->mag_age = 0.0;
            earth->field = found;
        }
    }
    if (!fresh && came(mag)) {
        senses->mag_rejected++;
        if (senses->mag_age - dt >= STAYS) { /* the next is believed */
            earth->field = ZERO;
            if (senses->heading_known == 1) senses->heading_known = DOUBTED;
        }
    }
    if (!*anew) change.x += nudge.x, change.y += nudge.y, change.z += nudge.z;
    if (moved) earth->field = slightly(change, earth->field);
    earth->up = slightly(change, earth->up);

    double w = predicted.w, x = predicted.x, y = predicted.y, z = predicted.z;
    double least = smaller(smaller(w, x), smaller(y, z));
    int turned = w * w > 0.5 ? w < 0.0 : -least > larger(larger(w, x), larger(y, z));
    senses->sign_corrections += turned != senses->turned;
    senses->turned = turned;
    return change;
}

/* senses.py */
static const double FASTEST = 350.0; /* rad/s; no gyroscope measures more */

/* What is known of a heading that one field told: given up if the next contradicts it. Returns the
   field, or none if it is not to be taken. */
static Vector confirm(Senses *senses, Earth *earth, Vector mag, Rotor rotor, double dt)
{
    Vector found = rotate(rotor, mag);
    double level = found.x * found.x + found.y * found.y;
    if (level <= LEVEL * LEVEL * square(found)) return mag;
    int off = is_glitch(found, earth->field, senses->mag_age + dt, dt)
           || found.x < AGREEING * sqrt(level), lost = square(earth->field) == 0.0;
    int known = senses->heading_known == 1 || senses->heading_known == ASKED;
    if (known && lost && is_other(mag, senses->mag, senses->mag_age + dt, dt)) {
        senses->mag_rejected++;
        senses->heading_known = senses->heading_known == 1 ? DOUBTED : FIRST_HEADING;
        return NONE;
    }
    if (senses->heading_known == DOUBTED) senses->heading_known = 1;
    if (senses->heading_known <= 1) return mag;
    if (off && lost)
        senses->mag_rejected += senses->heading_known <= FIRST_HEADING, senses->heading_known = 0;
    else if (off)
        senses->heading_known -= FIRST_HEADING + 1, senses->mag_rejected++, earth->field = ZERO;
    else
        senses->heading_known = 1;
    return mag;
}

/* Whether there is an attitude to start with, and which, in the sign of `predicted`. */
static int look(Senses *senses, Rotor turn, Vector accel, Vector mag, Rotor predicted, double dt,
                Rotor *snapshot)
{
    int fresh = heard(mag), has_up = usable(accel), found = 0;
    senses->mag_age = dt > 0.0 ? senses->mag_age + dt : INFINITY;
    senses->mag_rejected += came(mag) && !fresh, senses->accel_rejected += !has_up;
    Vector last = carried(turn, senses->mag);
    if (has_up && (fresh || senses->mag_age <= MAG_TIMEOUT))
        found = dcm(accel, fresh ? mag : last, snapshot);
    if (has_up && fresh && !found) fresh = 0, senses->mag_rejected++; /* along gravity */
    senses->mag = fresh ? mag : last;
    if (fresh) senses->mag_age = 0.0;
    senses->heading_known = found ? FIRST_HEADING : 0;
    if (has_up && !found) {
        Vector north = senses->started ? carried(unit(predicted), NORTH) : NORTH;
        found = dcm(accel, north, snapshot) || dcm(accel, UP, snapshot);
    }
    senses->started = found;
    if (!found) return 0;
    int turned = dot(*snapshot, predicted) < 0.0;
    if (turned) *snapshot = scaled(*snapshot, -1.0);
    senses->sign_corrections += turned != senses->turned;
    senses->turned = turned;
    return 1;
}

/* stateful.py */
static const double NEAR_UNIT = 1e-6, BELIEVED = 0.5;

/* Since the slow room looked back: time, corrections, rows; times since rows, the last step; the
   variance of turns that no rate told, and for how long a rate is being held. */
typedef struct {
    double time;
    Vector applied;
    int rows;
    double row_time, mag_row_time, step, doubt, held_for, gap_before;
} Past;

typedef struct {
    Rotor rotor, predicted;
    Senses senses;
    double elapsed;
    Pace pace;
    Learned learned;
    Room room;
    Past past;
    double row; /* s since the last row of the log, if this sample is one */
    int due; /* the slow room should look back before the next sample */
    Seen seen;
    Earth earth;
} State;

static inline Vector true_rate(const Learned *learned, Vector rate)
{
    return apply(&learned->axes, minus(rate, learned->bias));
}

static inline Vector true_field(const Learned *learned, Vector mag, Vector rate)
{
    if (!heard(mag)) return mag;
    Vector v = minus(mag, learned->hard_iron);
    return minus(v, times(learned->delay, cross(rate, v)));
}

/* Turn the rotor so that the mean of forces is up. */
static void at_once(State *s)
{
    Rotor change = uprighted(s->earth.up, 1.0);
    Vector turned = {2.0 * change.x, 2.0 * change.y, 2.0 * change.z};
    s->past.applied = total(s->past.applied, turned);
    s->earth.up = slightly(change, s->earth.up);
    s->earth.field = slightly(change, s->earth.field);
    s->rotor = product(change, s->rotor);
}

/* What the slow room should know of a step that turned the predicted rotor by `change`. */
static inline void passed(State *s, Rotor change, double dt, double lost, double held_for,
                          int begins, int starts)
{
    Past *past = &s->past;
    s->row = 0.0, s->due = begins;
    if (begins || starts) {
        *past = (Past){.applied = begins ? past->applied : ZERO, .mag_row_time = 1.0,
                       .step = begins ? dt : 0.0,
                       .gap_before = starts ? OFTEN : past->gap_before + past->time + dt};
        return;
    }
    int fresh = s->senses.mag_age == 0.0;
    past->time += dt, past->row_time += dt, past->mag_row_time += dt, past->step = dt;
    past->doubt += lost, past->held_for = held_for;
    if (past->row_time >= ROW_TIME || (fresh && past->mag_row_time >= ROW_TIME)) {
        past->rows++;
        s->row = past->row_time, past->row_time = 0.0;
        if (fresh) past->mag_row_time = 0.0;
    }
    past->applied.x += 2.0 * change.x;
    past->applied.y += 2.0 * change.y;
    past->applied.z += 2.0 * change.z;
    double window = s->elapsed > WINDOW ? WINDOW : 0.25 * WINDOW;
    s->due = past->rows > 0
          && (past->time >= window - 0.5 * dt || past->rows == ROWS || past->doubt > MUCH_LOST);
}

static inline void step(State *s, Gains gains, Vector gyro, Vector accel, Vector mag, double dt)
{
    const Learned *learned = &s->learned;
    Senses *senses = &s->senses;
    Vector last = senses->rate, rate = gyro, nudge = ZERO;
    int held = !(fabs(gyro.x) + fabs(gyro.y) + fabs(gyro.z) < FASTEST);
    if (held) rate = last, senses->gyro_rejected++;
    senses->rate = rate;
    Vector turn_rate = true_rate(learned, rate);
    mag = true_field(learned, mag, turn_rate);
    double lost = 0.0, held_for = 0.0, span = dt;
    if (held && dt > 0.0) {
        held_for = s->past.held_for + dt;
        lost = variance_lost(turn_rate, turn_rate, held_for);
        lost -= variance_lost(turn_rate, turn_rate, s->past.held_for);
    } else if (is_gap(dt, s->past.step)) {
        Vector before = true_rate(learned, last);
        int may_be_none = is_far(rate, last, JUMP_OF_RATE);
        lost = variance_lost(before, may_be_none ? before : turn_rate, dt);
        turn_rate = middle(before, turn_rate), span = -dt;
    }
    Rotor turn = from_rate(turn_rate, dt), change = IDENTITY, rotor;
    double undone = 0.0, jumped = s->seen.jumped + dt;
    if (0.0 < dt && dt < STAYS) {
        if (s->elapsed == 0.0 && s->earth.time == 0.0 && senses->started
            && contradicts(product(s->rotor, turn), &s->seen, accel)) {
            senses->started = senses->heading_known = 0, senses->mag_age = INFINITY, span = 0.0;
            senses->accel_rejected++;
        }
        double jump = jump_of_force(s->elapsed);
        int far_rate = is_far(rate, last, JUMP_OF_RATE);
        int far_force = s->earth.time > 0.0 && is_far(accel, s->seen.force, jump);
        int jumps = far_rate || is_far(accel, s->seen.force, jump);
        if (span > 0.0 && jumps && square(s->seen.force) > 0.0)
            jumped = s->seen.jumped >= SELDOM ? 0.0 : dt;
        if (span > 0.0 && (far_rate || far_force) && is_rare(&s->seen)) {
            Vector knock = ZERO;
            if (far_rate) knock = to_neighbours(last, s->seen.rate, rate, JUMP_OF_RATE);
            if (square(knock) > 0.0) {
                Rotor back = product(way_back(last, &s->seen, knock), turn);
                int late = s->elapsed > STAYS, clear = late && is_abrupt(knock, dt, &s->seen);
                int better = clear || is_better(product(s->rotor, back), product(s->rotor, turn),
                                                accel, mag, s->seen.field);
                if (!(better && late)) lost += variance_doubted(&s->seen, knock);
                if (better) turn = back, senses->gyro_rejected++;
            }
            if (far_force)
                undone = put_right(&s->earth.up, s->earth.time, s->rotor, turn, &s->seen, accel, jump);
            if (undone > 0.0) {
                senses->accel_rejected++;
                if (s->elapsed < START_LOW_PASSED) at_once(s);
            }
        }
    }
    /* What a start takes is in no low-pass, and nothing has turned by it. */
    s->seen = dt > 0.0 ? (Seen){last, span, accel, s->seen.force, s->earth.field,
                                jumped}
                       : (Seen){last, 0.0, ZERO, ZERO, ZERO, SELDOM};
    if (lost > 0.0) {
        s->earth.time = left_of(smaller(s->earth.time, LOW_PASS), lost);
        if (lost > MUCH_LOST) s->earth.field = ZERO;
        s->elapsed = left_of(smaller(s->elapsed, AVERAGED), lost);
    }
    if (span < 0.0) s->past.gap_before = -s->past.time;
    Rotor predicted = product(s->rotor, turn);
    if (dt != s->pace.dt) s->pace = paced(gains, s->pace, dt);
    double weight = s->pace.weight;
    int starts = dt <= 0.0 || !senses->started, begins = 0;
    if (s->elapsed < AVERAGED + undone && !starts)
        weight = at_start(weight, s->elapsed - undone, dt);
    s->elapsed += dt;
    if (!starts) {
        if (s->past.time < WINDOW) nudge = times(0.5 * dt, learned->drift);
        if ((senses->heading_known > 1 || square(s->earth.field) == 0.0) && heard(mag))
            mag = confirm(senses, &s->earth, mag, predicted, dt);
        change = corrected(senses, &s->earth, learned, accel, mag, predicted, nudge, s->pace,
                           weight, s->elapsed, &begins);
        rotor = product(change, predicted);
    } else if (look(senses, turn, accel, mag, predicted, dt, &rotor)) {
        begins = 1, s->elapsed = 0.0;
        s->earth = (Earth){rotate(rotor, accel), 0.0, rotate(rotor, senses->mag)};
    } else {
        rotor = predicted;
    }
    double size = dot(rotor, rotor);
    if (fabs(size - 1.0) < NEAR_UNIT) /* a root would take longer */
        s->rotor = scaled(rotor, 1.5 - 0.5 * size);
    else
        s->rotor = unit(rotor);
    s->predicted = predicted;
    passed(s, change, dt, lost, held_for, begins, starts);
}

/* Turn over a gap by the rates at its ends, and keep force and field for `resume`. */
static void wait(State *s, Vector rate, Vector accel, Vector mag, double dt)
{
    Senses *senses = &s->senses;
    Seen *seen = &s->seen;
    Vector last = senses->rate, earlier = seen->rate;
    Vector before = is_rare(seen) ? likely(earlier, last, rate) : last;
    Rotor turn = from_rate(true_rate(&s->learned, over_gap(before, rate, dt)), dt);
    if (is_far(before, last, JUMP_OF_RATE)) {
        senses->gyro_rejected++;
        turn = product(way_back(last, seen, minus(before, last)), turn);
    }
    double jump = jump_of_force(s->elapsed);
    if (s->earth.time > 0.0 && is_far(accel, seen->force, jump) && is_rare(seen)
        && put_right(&s->earth.up, s->earth.time, s->rotor, turn, seen, accel, jump) > 0.0) {
        senses->accel_rejected++;
        if (s->elapsed < START_LOW_PASSED) at_once(s);
    }
    senses->accel_rejected += !usable(accel), senses->mag_rejected += came(mag) && !heard(mag);
    senses->rate = rate, senses->mag_age += dt;
    *seen = (Seen){before, -dt, accel, carried(turn, seen->force), heard(mag) ? mag : ZERO,
                   seen->jumped};
    double variance = variance_over_gap(before, rate, dt);
    double more = larger(0.0, variance_over_gap(earlier, rate, dt) - variance);
    s->past.held_for = -1.0 - more;
    s->learned.heading_stddev = sqrt(squared(s->learned.heading_stddev) + variance + more);
    s->learned.tilt_stddev = sqrt(squared(s->learned.tilt_stddev) + variance + more);
    s->predicted = s->rotor = unit(product(s->rotor, turn));
    s->row = 0.0, s->due = 0;
}

/* The field of two samples: the second one's, the first one's if that is none, and none if they
   contradict each other. */
static Vector of_both(State *s, Vector first, Vector second, Rotor turn)
{
    if (!heard(first)) return second;
    Vector iron = s->learned.hard_iron, on = total(carried(turn, minus(first, iron)), iron);
    if (!heard(second)) {
        s->senses.mag_rejected += came(second);
        return on;
    }
    if (square(minus(second, on)) <= smaller(square(second), square(on))) return second;
    s->senses.mag_rejected += 2;
    return NONE;
}

/* Tell a gap anew, now that the second sample after it is there. Changes `accel` to the likely force
   of both, `mag` to the field of both; returns whether nothing is left known of the attitude. */
static int resume(State *s, Vector gyro, Vector *accel, Vector *mag, double dt)
{
    Senses *senses = &s->senses;
    Earth *earth = &s->earth;
    Past *past = &s->past;
    Seen seen = s->seen;
    int held = !(fabs(gyro.x) + fabs(gyro.y) + fabs(gyro.z) < FASTEST);
    Vector last = senses->rate, rate = held ? last : gyro, before = seen.rate;
    Rotor turn = from_rate(true_rate(&s->learned, rate), dt);
    *mag = of_both(s, seen.field, *mag, turn);
    int rare = is_rare(&seen);
    if (rare && usable(seen.force) && usable(seen.force_before) && usable(*accel)) {
        Vector second = rotate(turn, *accel);
        Vector force = likely(seen.force_before, seen.force, second);
        double jump = jump_of_force(s->elapsed);
        senses->accel_rejected += is_far(force, seen.force, jump) || is_far(force, second, jump);
        *accel = carried(turn, force);
    } else if (usable(seen.force) && !usable(*accel)) {
        senses->accel_rejected++;
        *accel = carried(turn, seen.force);
    }
    Vector meant = rare ? likely(before, last, rate) : last;
    double span = -seen.span;
    Rotor gap = from_rate(true_rate(&s->learned, over_gap(before, last, span)), span);
    Rotor anew = from_rate(true_rate(&s->learned, middle(before, meant)), span);
    s->rotor = product(s->rotor, product(conjugate(gap), anew));
    double lost = variance_doubted(&seen, shorter(minus(rate, meant), minus(meant, before)));
    lost += larger(variance_over_gap(before, last, span), variance_over_gap(before, rate, span))
          - (1.0 + past->held_for);

    past->time += span, past->row_time += span, past->mag_row_time += span;
    earth->time = left_of(smaller(earth->time, LOW_PASS), lost);
    s->elapsed = left_of(smaller(s->elapsed, AVERAGED), lost);
    if (lost > ALL_LOST) earth->time = s->elapsed = 0.0;
    if (lost > MUCH_LOST) {
        earth->field = ZERO;
        if (senses->mag_age <= span + MAG_TIMEOUT && s->learned.trust > BELIEVED
            && senses->heading_known == 1)
            senses->heading_known = ASKED;
        past->time = past->row_time = past->mag_row_time = 0.0, past->rows = 0;
    }
    if (usable(*accel)) {
        double counts = smaller(span, COUNTS);
        Vector up = rotate(product(s->rotor, turn), *accel);
        earth->time += counts, s->elapsed += counts;
        earth->up = total(earth->up, times(counts / earth->time, minus(up, earth->up)));
    }
    if (lost > ALL_LOST) at_once(s); /* as north will be told by it */
    senses->gyro_rejected += is_far(meant, last, JUMP_OF_RATE);
    senses->rate = meant;
    s->seen = (Seen){before, 0.0, seen.force, seen.force_before, earth->field,
                     seen.jumped + span};
    past->doubt += lost, past->held_for = 0.0, past->gap_before = -past->time, past->step = span;
    s->row = 0.0, s->due = 0;
    return lost > ALL_LOST;
}

/* Take the sample that waited where gaps are usual, now that the next is there. Changes `mag` to none
   if the two fields contradict each other. */
static void replay(State *s, Gains gains, Vector gyro, Vector accel, Vector *mag, double dt)
{
    Senses *senses = &s->senses;
    Seen seen = s->seen;
    double span = -seen.span;
    int held = !(fabs(gyro.x) + fabs(gyro.y) + fabs(gyro.z) < FASTEST);
    Vector last = senses->rate, rate = held ? last : gyro, before = seen.rate;
    Rotor turn = from_rate(true_rate(&s->learned, rate), dt);
    int rare = is_rare(&seen);
    Vector meant = rare ? likely(before, last, rate) : last, force = seen.force;
    Rotor gap = from_rate(true_rate(&s->learned, over_gap(before, last, span)), span);
    if (rare && usable(seen.force) && usable(seen.force_before) && usable(accel))
        force = likely(seen.force_before, seen.force, rotate(turn, accel));
    *mag = of_both(s, seen.field, *mag, turn);
    senses->gyro_rejected += is_far(meant, last, JUMP_OF_RATE);
    senses->accel_rejected += is_far(force, seen.force, jump_of_force(s->elapsed))
                            - !usable(seen.force);
    senses->rate = before, senses->mag_age -= span;
    double less = variance_over_gap(before, last, span) - (1.0 + s->past.held_for);
    Learned *told = &s->learned;
    told->heading_stddev = sqrt(larger(0.0, squared(told->heading_stddev) - less));
    told->tilt_stddev = sqrt(larger(0.0, squared(told->tilt_stddev) - less));
    s->past.held_for = 0.0;
    s->rotor = product(s->rotor, conjugate(gap));
    s->seen = (Seen){before, 0.0, seen.force_before, seen.force_before, s->earth.field,
                     seen.jumped};
    step(s, gains, meant, force, NONE, span);
    if (s->row > 0.0) s->past.rows--, s->past.row_time = s->row; /* the next is one instead */
    s->row = 0.0, s->due = 0;
}

/* A `step`, but after a gap, where a single bad sample would stand for all of it. Changes force and
   field to those that it took. */
static inline void take(State *s, Gains gains, Vector gyro, Vector *accel, Vector *mag, double dt)
{
    Past *past = &s->past;
    if (past->held_for == 0.0 && dt > GAP && is_gap(dt, past->step)
        && fabs(gyro.x) + fabs(gyro.y) + fabs(gyro.z) < FASTEST) {
        wait(s, gyro, *accel, *mag, dt);
        return;
    }
    int lost = 0;
    if (past->held_for < 0.0 && 0.0 < dt) {
        if (past->gap_before + past->time < OFTEN)
            replay(s, gains, gyro, *accel, mag, dt);
        else
            lost = resume(s, gyro, accel, mag, dt);
    }
    step(s, gains, gyro, *accel, *mag, dt);
    if (lost) {
        *past = (Past){.time = -1.0, .mag_row_time = 1.0, .step = past->step,
                       .gap_before = past->gap_before + past->time};
        s->row = 0.0, s->due = 1;
    }
}

/* Write the sample that made the state into the log, as its last row. */
static void note(Memory *m, const State *s, Vector accel, Vector mag)
{
    int felt = usable(accel), heard = s->past.mag_row_time == 0.0;
    m->log[s->past.rows - 1] = (Row){s->predicted, s->senses.rate, accel, mag, s->row, felt, heard};
}

/* The slow room's turn: after a window, a new start, or the first heading. */
static void look_back(State *s, Memory *m, Gains gains)
{
    Past *past = &s->past;
    if (past->rows > 0) {
        double kept = paced(gains, s->pace, past->step).weight;
        double tilt_rate = (1.0 - kept) / past->step;
        int starting = s->elapsed < START_LOW_PASSED;
        Window window = {past->rows, s->earth.up, past->applied, tilt_rate, starting, past->doubt};
        learn(m, &s->room, &s->learned, &window);
    } else if (past->time < 0.0) {
        attitude_lost(m, &s->room, &s->learned);
    } else if (s->elapsed > 0.0) {
        first_heading(m, past->applied);
    } else {
        start_anew(m, &s->room, &s->learned);
    }
    past->gap_before += larger(past->time, 0.0);
    past->time = 0.0, past->applied = ZERO, past->rows = 0, past->doubt = 0.0;
    s->row = 0.0, s->due = 0;
}

State state; /* after the last run: the filter keeps its own for who asks, too */

/* The rows are those of `Samples`, the settings those of `Settings`; a step of NaN is skipped. */
void run(long n, double alpha, double alpha_rate, const double *gyro, const double *accel,
         const double *mag, const double *steps, double *rotors)
{
    const Gains chosen = gains(alpha, alpha_rate);
    State s = {.rotor = IDENTITY,
               .senses = {.mag = NORTH, .mag_age = INFINITY},
               .predicted = IDENTITY,
               .pace = {.dt = -INFINITY},
               .past = {.mag_row_time = 1.0, .gap_before = OFTEN},
               .seen = {.jumped = SELDOM},
               .earth = {.up = UP}};
    Memory memory;
    begin(&memory, &s.room, &s.learned);
    for (long i = 0; i < n; i++, gyro += 3, accel += 3, mag += 3, rotors += 4) {
        if (s.due) look_back(&s, &memory, chosen);
        if (steps[i] == steps[i]) {
            Vector g = {gyro[0], gyro[1], gyro[2]}, a = {accel[0], accel[1], accel[2]};
            Vector m = {mag[0], mag[1], mag[2]};
            take(&s, chosen, g, &a, &m, steps[i]);
            if (s.row > 0.0) note(&memory, &s, a, m);
        }
        Rotor q = s.rotor;
        rotors[0] = q.w, rotors[1] = q.x, rotors[2] = q.y, rotors[3] = q.z;
    }
    state = s;
}
