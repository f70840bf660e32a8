/* What both filters in C need of rotor.py, snapshot/dcm.py, filters/senses.py and gains.py. */
#include <math.h>

typedef struct { double w, x, y, z; } Rotor;
typedef struct { double x, y, z; } Vector;

#define IDENTITY ((Rotor){1.0, 0.0, 0.0, 0.0})
#define NORTH ((Vector){1.0, 0.0, 0.0})
#define UP ((Vector){0.0, 0.0, 1.0})

static const double WEAKEST = 0.05, STRONGEST = 400.0; /* m/s^2 */
static const double MAG_TIMEOUT = 0.5; /* s */

static inline double squared(double x) { return x * x; }

/* As Python's; fmax and fmin heed NaN, and are calls. */
static inline double larger(double a, double b) { return b > a ? b : a; }

static inline double smaller(double a, double b) { return b < a ? b : a; }

static inline double inner(Vector u, Vector v) { return u.x * v.x + u.y * v.y + u.z * v.z; }

static inline double square(Vector v) { return inner(v, v); }

static inline Vector times(double s, Vector v) { return (Vector){s * v.x, s * v.y, s * v.z}; }

static inline Vector total(Vector u, Vector v)
{
    return (Vector){u.x + v.x, u.y + v.y, u.z + v.z};
}

static inline Vector minus(Vector u, Vector v)
{
    return (Vector){u.x - v.x, u.y - v.y, u.z - v.z};
}

static inline Vector cross(Vector u, Vector v)
{
    return (Vector){u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
}

static inline double dot(Rotor p, Rotor q)
{
    return p.w * q.w + p.x * q.x + p.y * q.y + p.z * q.z;
}

static inline Rotor scaled(Rotor q, double s)
{
    return (Rotor){q.w * s, q.x * s, q.y * s, q.z * s};
}

static inline Rotor unit(Rotor q) { return scaled(q, 1.0 / sqrt(dot(q, q))); }

static inline Rotor conjugate(Rotor q) { return (Rotor){q.w, -q.x, -q.y, -q.z}; }

static inline Rotor product(Rotor p, Rotor q)
{
    return (Rotor){p.w * q.w - p.x * q.x - p.y * q.y - p.z * q.z,
                   p.w * q.x + p.x * q.w + p.y * q.z - p.z * q.y,
                   p.w * q.y - p.x * q.z + p.y * q.w + p.z * q.x,
                   p.w * q.z + p.x * q.y - p.y * q.x + p.z * q.w};
}

/* Sensor to earth. */
static inline Vector rotate(Rotor q, Vector v)
{
    double tx = 2.0 * (q.y * v.z - q.z * v.y);
    double ty = 2.0 * (q.z * v.x - q.x * v.z);
    double tz = 2.0 * (q.x * v.y - q.y * v.x);
    return (Vector){v.x + q.w * tx + q.y * tz - q.z * ty,
                    v.y + q.w * ty + q.z * tx - q.x * tz,
                    v.z + q.w * tz + q.x * ty - q.y * tx};
}

/* Earth to sensor; what stands still, as a turn leaves it. */
static inline Vector carried(Rotor q, Vector v) { return rotate(conjugate(q), v); }

static inline Rotor from_rate(Vector rate, double dt)
{
    Vector v = times(0.5 * dt, rate);
    double size = square(v);
    if (size > 0.01) {
        double half = sqrt(size), s = sin(half) / half;
        return (Rotor){cos(half), s * v.x, s * v.y, s * v.z};
    }
    return (Rotor){1.0 - 0.5 * size, v.x, v.y, v.z};
}

/* Whether a sample can be a magnetic field, or a vector any direction. */
static inline int heard(Vector mag)
{
    double size = square(mag);
    return 1e-24 < size && size < 1e24;
}

/* Whether there is a sample, good or not. */
static inline int came(Vector mag) { return mag.x == mag.x || mag.y == mag.y || mag.z == mag.z; }

/* Whether specific force can be gravity's. */
static inline int usable(Vector accel)
{
    double size = square(accel);
    return squared(WEAKEST) < size && size < squared(STRONGEST);
}

/* Eq. 5-10. */
static inline int dcm(Vector a, Vector m, Rotor *q)
{
    if (!(heard(a) && heard(m))) return 0;
    Vector west = cross(a, m);
    double across = square(west);
    if (!(across > 1e-6 * square(a) * square(m))) return 0;
    double ra = sqrt(square(a)), rc = sqrt(across), one = ra * rc;
    Vector north = cross(west, a), up = times(rc, a);
    west = times(ra, west);
    double more = one + north.x, less = one - north.x;
    double both = west.y + up.z, apart = west.y - up.z;
    double d0 = more + both, d1 = more - both, d2 = less + apart, d3 = less - apart;
    double largest = larger(larger(d0, d1), larger(d2, d3));
    double s = 0.5 / sqrt(largest * one);
    if (largest == d0)
        *q = (Rotor){s * d0, s * (up.y - west.z), s * (north.z - up.x), s * (west.x - north.y)};
    else if (largest == d1)
        *q = (Rotor){s * (up.y - west.z), s * d1, s * (west.x + north.y), s * (north.z + up.x)};
    else if (largest == d2)
        *q = (Rotor){s * (north.z - up.x), s * (west.x + north.y), s * d2, s * (up.y + west.z)};
    else
        *q = (Rotor){s * (west.x - north.y), s * (north.z + up.x), s * (up.y + west.z), s * d3};
    return 1;
}

/* Settings, and the weight of the gyroscope path in a step after one of `last` s. */
static const double SERIES = 3e-3;

typedef struct { double alpha, alpha_rate, decay; } Gains;

static Gains gains(double alpha, double alpha_rate)
{
    return (Gains){alpha, alpha_rate, alpha > 0.0 ? alpha_rate * log(alpha) : -INFINITY};
}

static inline double paced_weight(Gains gains, double last, double weight, double dt)
{
    double x = gains.decay * (dt - last);
    if (fabs(x) < SERIES)
        return weight * (1.0 + x * (1.0 + x * (1.0 / 2.0 + x * (1.0 / 6.0 + x * (1.0 / 24.0)))));
    return gains.alpha_rate > 0.0 ? pow(gains.alpha, dt * gains.alpha_rate) : gains.alpha;
}
