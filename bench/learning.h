/* The slow room (learning.py and field.py of stateful_ahrs/filters) with its default settings. What
   its names mean, and in which units, stands there. */
#include <string.h>

#include "rotor.h"

#define DEGREE (3.14159265358979323846 / 180.0)
#define ZERO ((Vector){0.0, 0.0, 0.0})
#define NONE ((Vector){NAN, NAN, NAN})

enum { ROWS = 64, STATES = 15, LEARNED = 12, PER_AXIS = 4, WIDTH = 16 };

static const double WINDOW = 0.5, ROW_TIME = 0.037, REGAINED = 0.25, GRAVITY = 9.81;
static const double TILT_AT_START = 30.0 * DEGREE, HEADING_AT_START = 90.0 * DEGREE;
static const double BIAS_AT_START = 0.5 * DEGREE, MISALIGNMENT_AT_START = 0.005;
static const double HEADING_SHARE = 0.5, TILT_SHARE = 0.7;
static const double HEADING_FLOOR = 2.0 * DEGREE, TILT_FLOOR = 0.14 * DEGREE;
static const double ATTITUDE_WALK = 0.2 * DEGREE * (0.2 * DEGREE);
static const double BIAS_WALK = 0.015 * DEGREE * (0.015 * DEGREE);
/* Rest. */
static const double REST_RATE = 2.0 * DEGREE, REST_SIGMA = 4.0, REST_SLACK = 0.1 * DEGREE;
static const double REST_RATE_NOISE = 1.0 * DEGREE, REST_ACCEL_NOISE = 0.25;
static const double REST_VARIANCE = 0.015 * DEGREE * (0.015 * DEGREE);
static const int REST_WINDOWS = 4;
/* Tilt and heading. */
static const double LOW_PASS = 2.0, TILT_VARIANCE = 0.02 * 0.02, TILT_PER_MOTION = 0.01;
static const double LEVEL = 1e-3, HEADING_VARIANCE = 12.0 * DEGREE * (12.0 * DEGREE);
static const double SETTLING = 4.0;
/* Delay. */
static const double DELAY_BLOCK = 2.0, DELAY_RANGE[2] = {-0.005, 0.030};
/* The field against a reference, and another that may take its place. */
static const double FIELD_SMOOTH = 1.5, NORM_SPREAD = 0.025, DIP_SPREAD = 0.05, SUDDEN = 0.25;
static const double OFF = 10.0, REFERENCE = 40.0, YOUNG = 20.0;
static const double UNTRIED = 2.0, UNTRIED_HEADING = 6.0 * DEGREE;
static const double CANDIDATE_SPREAD = 9.0, NEARLY_FAR = 12.0, CANDIDATE_FAR = 16.0;
static const double CANDIDATE_AGE = 1.0, OLDEST = 40.0, TRIED = 4.0, LOST = 10.0 * DEGREE, AGREES = 16.0;
static const double REST_COUNTS = 0.05, TURNS = 0.05, REPEATS = 4.0;
static const double SURPRISE_TIME = 5.0, SURPRISE_SPREAD = 2.0 * DEGREE;
static const double SWAP_DEVIATION = 5.0 * DEGREE;
/* Hard iron left over. */
static const double IRON_AT_START = 0.1, IRON_NOISE = 0.04, IRON_SEEN = 0.05, IRON_RANGE = 10.0;
static const double UNIT_OFF = 0.5, ANOTHER = 0.03;
static const double LEAP = 0.05, LEAP_PER_TURN = 0.7, LEAP_OF_ONE = 0.3;
static const double FREED = 1e6;
static const double IRON_FORGET = 200.0, IRON_FORGET_DISTURBED = 10.0;

/* Which states a measurement may correct. */
static const double FREE[WIDTH] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
static const double ALL_BUT_TILT[WIDTH] = {0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};

typedef struct { double row[3][3]; } Matrix;

typedef struct { Rotor predicted; Vector rate, force, mag; double span; int felt, heard; } Row;

typedef struct {
    double covariance[WIDTH][WIDTH], error[3], lag[2][LEARNED], iron[4][5];
    double effect[3][LEARNED], state[WIDTH], row[WIDTH]; /* for the time of a look back */
    Row log[ROWS];
} Memory;

typedef struct {
    Vector bias, hard_iron, drift;
    Matrix axes; /* 1 + E */
    double delay, trust, heading_rate, heading_stddev, tilt_stddev;
    int resting;
} Learned;

typedef struct {
    double time, last, norm, dip, norm_reference, dip_reference, reference_age;
    double norm_candidate, dip_candidate, candidate_age, looks, surprise, left, left_age, rival;
} Field;

typedef struct { Vector field, rate; double square, rows, time, moment, weight; } Delay;

typedef struct {
    double elapsed, unit, missed;
    int rest_windows, swaps;
    Field field;
    Delay delay;
} Room;

typedef struct {
    int rows;
    Vector up, applied;
    double tilt_rate;
    int starting;
    double doubt;
} Window;

typedef struct {
    double time, rate_noise, accel_noise, motion, field_rate_square, unit, largest;
    int felt, heard;
    Vector rate, field, field_rate;
    double xx, xy, xz, yy, yz, zz, qq; /* of the sphere: m m', |m|^2, */
    Vector m, q; /* m and |m|^2 m */
} Sums;

static inline Vector apply(const Matrix *m, Vector v)
{
    return (Vector){m->row[0][0] * v.x + m->row[0][1] * v.y + m->row[0][2] * v.z,
                    m->row[1][0] * v.x + m->row[1][1] * v.y + m->row[1][2] * v.z,
                    m->row[2][0] * v.x + m->row[2][1] * v.y + m->row[2][2] * v.z};
}

static void forget_heading(Memory *m, double variance)
{
    for (int j = 0; j < STATES; j++) m->covariance[2][j] = m->covariance[j][2] = 0.0;
    m->covariance[2][2] = variance;
}

static void forget_attitude(Memory *m)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < STATES; j++) m->covariance[i][j] = m->covariance[j][i] = 0.0;
    m->covariance[0][0] = m->covariance[1][1] = squared(TILT_AT_START);
    m->covariance[2][2] = squared(HEADING_AT_START);
    memset(m->error, 0, sizeof m->error);
    memset(m->lag, 0, sizeof m->lag);
}

/* Let the constant of the sphere walk: another field has another norm, but the same iron. */
static void free_norm(Memory *m, double variance)
{
    double part = variance / (1.0 + variance * m->iron[3][3]), shares[4];
    for (int i = 0; i < 4; i++) shares[i] = part * m->iron[i][3];
    for (int j = 0; j < 5; j++) {
        double last = m->iron[3][j];
        for (int i = 0; i < 4; i++) m->iron[i][j] -= shares[i] * last;
    }
}

/* A new start with the same sensor: attitude and field unknown, calibration kept. */
static void start_anew(Memory *m, Room *room, Learned *learned)
{
    forget_attitude(m);
    free_norm(m, FREED);
    Delay delay = {.moment = room->delay.moment, .weight = room->delay.weight};
    *room = (Room){.unit = room->unit, .swaps = room->swaps, .delay = delay};
    learned->trust = 1.0, learned->heading_rate = 0.0, learned->drift = ZERO;
    learned->heading_stddev = HEADING_SHARE * HEADING_AT_START;
    learned->tilt_stddev = TILT_SHARE * TILT_AT_START;
    learned->resting = 0;
}

/* After a gap in which the attitude was lost; sensors and field are as they were. */
static void attitude_lost(Memory *m, Room *room, Learned *learned)
{
    forget_attitude(m);
    room->elapsed = 0.0, room->rest_windows = 0;
    learned->heading_rate = 0.0, learned->drift = ZERO;
    learned->heading_stddev = HEADING_SHARE * HEADING_AT_START;
    learned->tilt_stddev = TILT_SHARE * TILT_AT_START;
    learned->resting = 0;
}

static void begin(Memory *m, Room *room, Learned *learned)
{
    memset(m, 0, sizeof *m);
    for (int i = 3; i < STATES; i++)
        m->covariance[i][i] = squared(i % PER_AXIS == 3 ? BIAS_AT_START : MISALIGNMENT_AT_START);
    *room = (Room){.delay = {.weight = 1.0}};
    *learned = (Learned){.axes = {{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}}};
    start_anew(m, room, learned);
}

/* The fast path took its first heading whole. */
static void first_heading(Memory *m, Vector applied)
{
    forget_heading(m, squared(HEADING_AT_START));
    m->error[0] -= applied.x, m->error[1] -= applied.y, m->error[2] = 0.0;
}

/* One scalar Kalman update with `row`; returns 1 / (variance of the innovation). Whole rows of the
   covariance are taken at once, which gcc does if it does not unroll them first. */
static double measure(Memory *m, const double *free, double variance, double value)
{
    double gain[WIDTH] = {0.0}, freed[WIDTH], kept[WIDTH];
    for (int i = 0; i < STATES; i++)
        if (m->row[i] != 0.0)
#pragma GCC unroll 1
            for (int j = 0; j < WIDTH; j++) gain[j] += m->row[i] * m->covariance[i][j];
    for (int j = 0; j < STATES; j++) {
        variance += m->row[j] * gain[j];
        value -= m->row[j] * m->state[j];
    }
    double scale = 1.0 / variance, root = sqrt(scale);
    for (int j = 0; j < WIDTH; j++) gain[j] *= root;
    for (int j = 0; j < WIDTH; j++) freed[j] = gain[j] * free[j];
    for (int j = 0; j < WIDTH; j++) kept[j] = gain[j] - freed[j];
    for (int j = 0; j < WIDTH; j++) m->state[j] += value * root * freed[j];
    for (int i = 0; i < STATES; i++)
#pragma GCC unroll 1
        for (int j = 0; j < WIDTH; j++)
            m->covariance[i][j] -= gain[i] * freed[j] + freed[i] * kept[j];
    return scale;
}

/* Sensor to earth, of a unit rotor. */
static inline Matrix matrix(Rotor q)
{
    return (Matrix){{
        {1.0 - 2.0 * (q.y * q.y + q.z * q.z), 2.0 * (q.x * q.y - q.w * q.z),
         2.0 * (q.x * q.z + q.w * q.y)},
        {2.0 * (q.x * q.y + q.w * q.z), 1.0 - 2.0 * (q.x * q.x + q.z * q.z),
         2.0 * (q.y * q.z - q.w * q.x)},
        {2.0 * (q.x * q.z - q.w * q.y), 2.0 * (q.y * q.z + q.w * q.x),
         1.0 - 2.0 * (q.x * q.x + q.y * q.y)},
    }};
}

/* Read the log: what the window was like, and into `effect` what b and E did. */
static Sums gather(Memory *m, const Window *window, const Learned *learned, double unit)
{
    Sums sums = {0};
    Vector accel = ZERO;
    double rate_square = 0.0, accel_square = 0.0, per_unit = unit > 0.0 ? 1.0 / unit : 0.0;
    double last = 0.0, since = 0.0;
    memset(m->effect, 0, sizeof m->effect);
    for (int n = 0; n < window->rows; n++) {
        const Row *row = &m->log[n];
        const Matrix turn = matrix(row->predicted);
        sums.time += row->span, since += row->span;
        Vector unbiased = minus(row->rate, learned->bias), moved = times(row->span, unbiased);
        const double did[PER_AXIS] = {-row->span, moved.x, moved.y, moved.z};
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                for (int k = 0; k < PER_AXIS; k++)
                    m->effect[i][PER_AXIS * j + k] += turn.row[i][j] * did[k];
        sums.rate = total(sums.rate, row->rate);
        rate_square += square(row->rate);
        if (row->felt) {
            sums.felt++;
            accel = total(accel, row->force);
            accel_square += square(row->force);
            Vector level = minus(apply(&turn, row->force), window->up);
            sums.motion += level.x * level.x + level.y * level.y;
        }
        if (!row->heard) continue;
        sums.heard++;
        Vector mag = minus(row->mag, learned->hard_iron);
        Vector late = cross(apply(&learned->axes, unbiased), mag);
        sums.field = total(sums.field, apply(&turn, mag));
        sums.field_rate = total(sums.field_rate, apply(&turn, late));
        sums.field_rate_square += square(late);
        double ratio = square(late) / (square(mag) + 1e-30);
        if (unit == 0.0) unit = sqrt(square(row->mag)) + 1e-30, per_unit = 1.0 / unit;
        mag = times(per_unit, row->mag);
        double size = square(mag);
        sums.largest = larger(sums.largest, size);
        double off = fabs(size - last), of_both = 0.5 * (size + last);
        if (last > 0.0 && off > LEAP_OF_ONE * of_both
            && off > (LEAP_OF_ONE + LEAP_PER_TURN * since * sqrt(ratio)) * of_both)
            sums.largest = INFINITY;
        last = size, since = 0.0;
        sums.xx += mag.x * mag.x, sums.xy += mag.x * mag.y, sums.xz += mag.x * mag.z;
        sums.yy += mag.y * mag.y, sums.yz += mag.y * mag.z, sums.zz += mag.z * mag.z;
        sums.m = total(sums.m, mag), sums.qq += size;
        sums.q = total(sums.q, times(size, mag));
    }
    double each = 1.0 / window->rows, heard = 1.0 / (sums.heard > 1 ? sums.heard : 1);
    sums.rate = times(each, sums.rate);
    sums.rate_noise = rate_square * each - square(sums.rate);
    double of_force = 1.0 / (sums.felt > 1 ? sums.felt : 1);
    sums.accel_noise = accel_square * of_force - square(times(of_force, accel));
    sums.motion *= of_force;
    sums.field = times(heard, sums.field);
    sums.field_rate = times(heard, sums.field_rate);
    sums.field_rate_square *= heard;
    sums.unit = unit;
    return sums;
}

/* Let the covariance of delta grow by what b and E did in `time` s, and by what b may do. */
static void propagate(Memory *m, double time)
{
    double (*p)[WIDTH] = m->covariance, shift[3][LEARNED] = {{0.0}};
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < LEARNED; k++)
#pragma GCC unroll 1
            for (int j = 0; j < LEARNED; j++) shift[i][j] += m->effect[i][k] * p[3 + k][3 + j];
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++) {
            double sum = p[i][j];
            for (int k = 0; k < LEARNED; k++) {
                sum += m->effect[i][k] * p[j][3 + k];
                sum += m->effect[j][k] * (p[i][3 + k] + shift[i][k]);
            }
            p[i][j] = p[j][i] = sum;
        }
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < LEARNED; k++) p[3 + k][i] = p[i][3 + k] += shift[i][k];
        p[i][i] += ATTITUDE_WALK * time;
        p[3 + PER_AXIS * i][3 + PER_AXIS * i] += BIAS_WALK * time;
    }
}

/* Whether a mean rate is so near to the known bias as that is sure: else it turns. */
static int is_bias(const Memory *m, const double off[3])
{
    for (int i = 0; i < 3; i++) {
        double sigma = sqrt(m->covariance[3 + PER_AXIS * i][3 + PER_AXIS * i]);
        if (!(fabs(off[i]) < REST_SIGMA * sigma + REST_SLACK)) return 0;
    }
    return 1;
}

/* The field stands still in the earth frame, so what moves with R(w x m) is delay. */
static void delay_of(Delay *d, const Sums *sums, double trust)
{
    double n = sums->heard;
    d->field = total(d->field, times(n, sums->field));
    d->rate = total(d->rate, times(n, sums->field_rate));
    d->square += sums->field_rate_square * n;
    d->rows += n, d->time += sums->time;
    if (d->time < DELAY_BLOCK - 0.01) return;
    double scale = d->time * trust * d->rows / (square(d->field) + 1e-30);
    double moment = d->moment - scale * inner(d->field, d->rate) / d->rows;
    double weight = d->weight + scale * (d->square - square(d->rate) / d->rows);
    *d = (Delay){.moment = moment, .weight = weight};
}

/* The first three unknowns of four symmetric positive equations, which it consumes. */
static Vector solve(double (*a)[5])
{
    for (int i = 0; i < 4; i++)
        for (int j = i + 1; j < 4; j++) {
            double part = a[j][i] / a[i][i];
            for (int k = i; k < 5; k++) a[j][k] -= part * a[i][k];
        }
    double w = a[3][4] / a[3][3];
    double z = (a[2][4] - a[2][3] * w) / a[2][2];
    double y = (a[1][4] - a[1][2] * z - a[1][3] * w) / a[1][1];
    return (Vector){(a[0][4] - a[0][2] * z - a[0][3] * w - a[0][1] * y) / a[0][0], y, z};
}

/* Hard iron from the norm: |m|^2 = 2 m.h + const on a sphere about h. */
static Vector hard_iron_of(Memory *m, const Sums *s, double turned, double trust, double other,
                           double leap, Vector last)
{
    if (!(s->largest < squared(IRON_RANGE))) return last;
    if (fabs(leap) > LEAP + LEAP_PER_TURN * turned) {
        free_norm(m, FREED);
        return last;
    }
    if (fabs(other) > ANOTHER) free_norm(m, squared(squared(other)) * s->time / WINDOW);
    double weight = smaller(1.0, turned) / (s->heard * squared(2.0 * IRON_NOISE)), solved[4][5];
    double fade = exp(-turned * (trust / IRON_FORGET + (1.0 - trust) / IRON_FORGET_DISTURBED));
    const double rows[4][5] = {
        {4.0 * s->xx, 4.0 * s->xy, 4.0 * s->xz, 2.0 * s->m.x, 2.0 * s->q.x},
        {4.0 * s->xy, 4.0 * s->yy, 4.0 * s->yz, 2.0 * s->m.y, 2.0 * s->q.y},
        {4.0 * s->xz, 4.0 * s->yz, 4.0 * s->zz, 2.0 * s->m.z, 2.0 * s->q.z},
        {2.0 * s->m.x, 2.0 * s->m.y, 2.0 * s->m.z, s->heard, s->qq},
    };
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < 5; j++)
            solved[i][j] = m->iron[i][j] = fade * m->iron[i][j] + weight * rows[i][j];
        solved[i][i] += i < 3 ? 1.0 / squared(IRON_AT_START) : 1e-6;
    }
    Vector iron = solve(solved);
    return times(s->unit * larger(0.0, 1.0 - squared(IRON_SEEN) / (square(iron) + 1e-12)), iron);
}

/* The sum of the squares of how far a field is off another, in standard deviations. */
static double apart(double norm, double dip, double other_norm, double other_dip)
{
    return squared((norm - other_norm) / (NORM_SPREAD * other_norm))
         + squared((dip - other_dip) / DIP_SPREAD);
}

/* Write the equations of the sphere in a unit that is so many times theirs. */
static void give_unit(Memory *m, double times)
{
    double small = 1.0 / times;
    const double column[5] = {small, small, small, 1.0, squared(small)};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 5; j++) m->iron[i][j] *= (i < 3 ? small : 1.0) * column[j];
}

/* The same angle (rad) from -pi to pi. */
static double around(double angle)
{
    return angle - 360.0 * DEGREE * floor(angle / (360.0 * DEGREE) + 0.5);
}

/* How likely a field is the right one, rather than another of that age (s of motion). */
static double odds(double age, double other)
{
    return age * age / (age * age + other * other + 1e-12);
}

/* Compare a window's field with the reference, and with another one that may take its place. Returns
   how far it can be trusted, and sets `swapped` if another took the place. */
static double compared(Field *f, double norm, double dip, double north, double held, double turned,
                       double time, int *swapped)
{
    f->time += time;
    double share = smaller(1.0, larger(1.0 - exp(-time / FIELD_SMOOTH), time / f->time));
    f->norm += share * (norm - f->norm), f->dip += share * (dip - f->dip);
    if (f->norm_reference == 0.0) {
        f->norm_reference = f->norm_candidate = f->norm;
        f->dip_reference = f->dip_candidate = f->dip;
    }
    double motion = smaller(turned, time) + REST_COUNTS * time;
    if (apart(norm, dip, f->norm_candidate, f->dip_candidate) > CANDIDATE_SPREAD)
        f->norm_candidate = norm, f->dip_candidate = dip, f->candidate_age = 0.0;
    f->candidate_age += motion;
    share = motion / smaller(f->candidate_age, OLDEST);
    f->norm_candidate += share * (norm - f->norm_candidate);
    f->dip_candidate += share * (dip - f->dip_candidate);
    double off = apart(f->norm, f->dip, f->norm_reference, f->dip_reference);
    double now = apart(norm, dip, f->norm_reference, f->dip_reference);
    /* A field that has stayed as long as a reference hardly tried is as likely the honest one. */
    double age = larger(f->reference_age, 1e-3);
    double untried = UNTRIED / age * (1.0 + smaller(1.0, f->candidate_age / age));
    double off_now = larger(off, SUDDEN * now), alike = 1.0 / (1.0 + off_now);
    off_now /= 1.0 + untried * untried;
    double trust = 1.0 / (1.0 + off_now * (1.0 + off_now / OFF));
    f->reference_age = smaller(f->reference_age + motion * alike, OLDEST);
    f->rival = 0.0;
    if (f->left_age > 0.0) {
        f->left_age *= exp(-motion * alike / OLDEST);
        f->rival = squared(f->left) * odds(f->left_age, f->reference_age);
    }
    int another = off > CANDIDATE_SPREAD;
    int far = off + squared(f->surprise / SURPRISE_SPREAD) > CANDIDATE_FAR;
    int older = f->candidate_age >= larger(CANDIDATE_AGE, f->reference_age);
    if (another && f->looks > TRIED) /* then only if nobody knows better, or it makes no difference */
        older &= held + f->rival > squared(LOST) || squared(f->surprise) < AGREES * held;
    else if (another && f->reference_age > UNTRIED) /* where nothing turns, nothing is lost by waiting */
        older &= turned > TURNS * time;
    *swapped = far && older;
    f->looks += trust * turned;
    if (*swapped) {
        f->left = north, f->left_age = f->reference_age;
        f->norm_reference = f->norm = f->norm_candidate;
        f->dip_reference = f->dip = f->dip_candidate;
        f->reference_age = smaller(f->candidate_age, OLDEST);
        f->looks = turned, f->surprise = 0.0;
        trust = 1.0;
        f->rival = squared(f->left) * odds(f->left_age, f->reference_age);
    } else {
        share = time / f->time;
        if (f->time >= YOUNG) share = trust * larger(time / REFERENCE, share);
        f->norm_reference += share * (f->norm - f->norm_reference);
        f->dip_reference += share * (f->dip - f->dip_reference);
        share = smaller(1.0, motion / SURPRISE_TIME);
        f->surprise = around(f->surprise + share * around(north - f->surprise));
        /* What a field that is off says it says as a whole, and not anew in each window. */
        double repeats = (off - NEARLY_FAR) / (CANDIDATE_FAR - NEARLY_FAR);
        trust /= squared(1.0 + smaller(1.0, larger(0.0, repeats)) * f->candidate_age / REPEATS);
        if (another) f->rival += squared(f->surprise) * odds(f->candidate_age, f->reference_age);
    }
    f->last = norm;
    return trust;
}

/* The magnetometer's part: delay, hard iron, trust and heading. Returns what of the heading error
   the fast path will correct by itself. */
static double hear(Memory *m, Room *room, Learned *learned, const Sums *sums, const Window *window,
                   double settling)
{
    Field *f = &room->field;
    double time = sums->time;
    delay_of(&room->delay, sums, learned->trust);
    double delay = room->delay.moment / room->delay.weight;
    learned->delay = smaller(larger(delay, DELAY_RANGE[0]), DELAY_RANGE[1]);
    Vector field = minus(sums->field, times(learned->delay, sums->field_rate));
    double level = sqrt(field.x * field.x + field.y * field.y) + 1e-30;
    double norm = sqrt(level * level + field.z * field.z), dip = field.z / norm;
    double turned = sqrt(sums->field_rate_square) / norm * time; /* rad, in the sensor frame */
    double other = 0.0, leap = 0.0;
    if (f->norm_reference > 0.0) {
        other = squared(norm / f->norm_reference) - 1.0;
        leap = other + 1.0 - squared(f->last / f->norm_reference);
    }
    learned->hard_iron =
        hard_iron_of(m, sums, turned, learned->trust, other, leap, learned->hard_iron);
    double innovation = atan2(field.y, field.x), north = innovation + m->state[2];
    double *heading = m->covariance[2], held = squared(HEADING_SHARE) * heading[2];
    int swapped;
    double trust = compared(f, norm, dip, north, held, turned, time, &swapped);
    if (swapped) {
        room->swaps++;
        forget_heading(m, squared(SWAP_DEVIATION) + squared(north));
    }
    if (!(UNIT_OFF * room->unit < f->norm_reference
          && f->norm_reference < room->unit / UNIT_OFF)) { /* the first sample was a bad one */
        give_unit(m, f->norm_reference / room->unit);
        room->unit = f->norm_reference;
    }

    /* Heading. The magnetometer never moves tilt. */
    learned->trust = trust, learned->heading_rate = 0.0;
    double least = squared(UNTRIED_HEADING / (1.0 + f->looks));
    heading[2] = larger(heading[2], least);
    if (!(level > LEVEL * norm)) return 0.0;
    double steep = field.z / level, toward = heading[2], was = m->state[2];
    m->row[0] = steep, m->row[1] = 0.0, m->row[2] = -1.0;
    for (int k = 0; k < LEARNED; k++)
        m->row[3 + k] = 0.5 * (m->effect[2][k] - steep * m->effect[0][k]);
    for (int j = 0; j < STATES; j++)
        if (j != 2) toward -= m->row[j] * heading[j];
    double variance = HEADING_VARIANCE / (trust * time) * settling;
    double scale = measure(m, ALL_BUT_TILT, variance, innovation);
    double gain = smaller(larger(toward * scale, 0.0), 0.999), own = m->state[2] - was;
    learned->heading_rate = -log(1.0 - gain) / time;
    if (!window->starting && window->tilt_rate < learned->heading_rate)
        own *= (1.0 - exp(-time * window->tilt_rate)) / gain;
    return own;
}

/* Look back on a window. */
static void learn(Memory *m, Room *room, Learned *learned, const Window *window)
{
    Vector up = window->up;
    Sums sums = gather(m, window, learned, room->unit);
    double time = sums.time;
    room->unit = sums.unit, room->elapsed += time;
    double settling = 1.0 + squared(SETTLING / room->elapsed);

    propagate(m, time);
    for (int i = 0; i < 3; i++) m->covariance[i][i] += window->doubt / squared(HEADING_SHARE);
    memset(m->state, 0, sizeof m->state);
    memset(m->row, 0, sizeof m->row);
    double x0 = m->state[0] = m->error[0] - window->applied.x;
    double y0 = m->state[1] = m->error[1] - window->applied.y;
    double z0 = m->state[2] = m->error[2] - window->applied.z;

    /* Rest: the gyroscope reads its bias. */
    Vector rate = sums.rate, rest = minus(rate, learned->bias);
    const double off[3] = {rest.x, rest.y, rest.z};
    int rests = sums.rate_noise < squared(REST_RATE_NOISE) && sums.felt > 0
             && sums.accel_noise < squared(REST_ACCEL_NOISE)
             && larger(larger(fabs(rate.x), fabs(rate.y)), fabs(rate.z)) < REST_RATE
             && is_bias(m, off);
    room->rest_windows = rests ? room->rest_windows + 1 : 0;
    learned->resting = room->rest_windows >= REST_WINDOWS;
    for (int i = 0; i < 3 && learned->resting; i++) {
        m->row[3 + PER_AXIS * i] = 1.0;
        measure(m, FREE, REST_VARIANCE / time, off[i]);
        m->row[3 + PER_AXIS * i] = 0.0;
    }

    /* Tilt: the low-passed up should be vertical. */
    double fade = exp(-time / LOW_PASS), fill = LOW_PASS / time * (1.0 - fade);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < LEARNED; k++)
            m->lag[i][k] = fade * m->lag[i][k] + fill * m->effect[i][k];
    double length = sqrt(square(up)) + 1e-12, motion = 0.5 * sums.motion / squared(GRAVITY);
    double variance = (TILT_VARIANCE + TILT_PER_MOTION * motion) * settling;
    double own_x = 0.0, own_y = 0.0, own_z = 0.0;
    room->missed = smaller(fade * room->missed + window->doubt, squared(TILT_SHARE * TILT_AT_START));
    if (sums.felt > 0) {
        variance *= (double)window->rows / sums.felt;
        double x1 = m->state[0];
        m->row[0] = 1.0;
        for (int k = 0; k < LEARNED; k++) m->row[3 + k] = -m->lag[0][k];
        measure(m, FREE, variance, up.y / length);
        double x2 = m->state[0], y2 = m->state[1];
        m->row[0] = 0.0, m->row[1] = 1.0;
        for (int k = 0; k < LEARNED; k++) m->row[3 + k] = -m->lag[1][k];
        measure(m, FREE, variance, -up.x / length);
        own_x = x2 - x1, own_y = m->state[1] - y2;
    }

    learned->heading_rate = 0.0;
    if (sums.heard > 0) own_z = hear(m, room, learned, &sums, window, settling);
    memcpy(m->error, m->state, sizeof m->error);
    double x = m->state[0], y = m->state[1], z = m->state[2];
    learned->drift = (Vector){(x - x0 - own_x) / WINDOW, (y - y0 - own_y) / WINDOW,
                              (z - z0 - own_z + REGAINED * z0) / WINDOW};
    double tilt = 0.5 * (m->covariance[0][0] + m->covariance[1][1] + x * x + y * y);
    double heading = m->covariance[2][2] + z * z;
    learned->heading_stddev =
        sqrt(squared(HEADING_SHARE) * heading + squared(HEADING_FLOOR) + room->field.rival);
    learned->tilt_stddev = sqrt(squared(TILT_SHARE) * tilt + squared(TILT_FLOOR) + room->missed);
    learned->bias = total(learned->bias, (Vector){m->state[3], m->state[7], m->state[11]});
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) learned->axes.row[i][k] += m->state[4 + PER_AXIS * i + k];
}
