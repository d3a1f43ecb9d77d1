/* The paper's adaptive fading unscented filter on 8 states with the paraboloid, written by hand: what the compiled
   kernel is measured against. The same algorithm (sigma points for the excess of force only) and the same guards,
   without marks and restarts. State: mean (8), covariance (64), force before, count (unused), fading factor. Sample:
   force, rate, interval. Settings: sigma_u, sigma_vel, mass, kappa per elasticity, lambda per viscosity, theta,
   alpha_max, step up, step down, cap (8), reach and weight of the points, weight of the shift.
   Output: elasticity, viscosity, depth, NIS. */
#include <math.h>
#include <string.h>

enum { N = 8 };

static inline double contact(double d, double v, double E, double eta, double ck, double cl) {
    const double root = sqrt(d > 0 ? d : 1.0);
    return d > 0 ? ck * E * d * root + cl * eta * root * v : 0.0;
}

void run(long count, double *state, const double *samples, const double *settings, double *outputs) {
    double x[N], P[N][N], before = state[72], factor = state[74];
    const double ru = settings[0] * settings[0], rv = settings[1] * settings[1];
    const double m = settings[2], ck = settings[3], cl = settings[4];
    const double theta = settings[5], largest = settings[6], up = settings[7], down = settings[8];
    const double *cap = settings + 9;
    const double reach = settings[17], weight = settings[18], correction = settings[19];
    memcpy(x, state, sizeof x);
    memcpy(P, state + N, sizeof P);
    for (long i = 0; i < count; i++) {
        const double u = before, z = samples[3 * i + 1], T = samples[3 * i + 2];
        const double b0 = T * T / (2 * m), b1 = T / m, h = T * T / 2;
        const int known = fabs(u) <= 1e300, seen = fabs(z) <= 1e300;
        double L[N][N];
        for (int j = 0; j < N; j++) {
            double pivot = P[j][j];
            for (int k = 0; k < j; k++) pivot -= L[j][k] * L[j][k];
            const double diagonal = sqrt(fmax(pivot, 0.0));
            const double inverse = pivot > 0 ? 1.0 / diagonal : 0.0;
            L[j][j] = diagonal;
            for (int r = j + 1; r < N; r++) {
                double sum = P[r][j];
                for (int k = 0; k < j; k++) sum -= L[r][k] * L[j][k];
                L[r][j] = sum * inverse;
            }
        }
        const double centre = contact(x[0], x[1], x[2], x[3], ck, cl);
        double slope[4], sum = 0, squares = 0;
        for (int j = 0; j < 4; j++) {
            double a[4], b[4];
            for (int k = 0; k < 4; k++) {
                const double off = k < j ? 0.0 : reach * L[k][j];
                a[k] = x[k] + off;
                b[k] = x[k] - off;
            }
            const double p = centre - contact(a[0], a[1], a[2], a[3], ck, cl);
            const double q = centre - contact(b[0], b[1], b[2], b[3], ck, cl);
            slope[j] = weight * reach * (p - q);
            sum += p + q;
            squares += p * p + q * q;
        }
        const double shift = weight * sum, spread = weight * squares + correction * shift * shift;
        double c[N];
        for (int r = 0; r < N; r++) {
            c[r] = 0;
            for (int j = 0; j < 4; j++) c[r] += (j <= r ? L[r][j] : 0.0) * slope[j];
        }
        const double excess = known ? u - centre + shift : 0.0;
        x[0] += T * x[1] + b0 * excess;
        x[1] += b1 * excess;
        x[2] += T * x[4] + h * x[6];
        x[3] += T * x[5] + h * x[7];
        x[4] += T * x[6];
        x[5] += T * x[7];
        c[0] += T * c[1];
        for (int r = 2; r < 4; r++) c[r] += T * c[r + 2] + h * c[r + 4];
        for (int r = 4; r < 6; r++) c[r] += T * c[r + 2];
        for (int k = 0; k < N; k++) P[0][k] += T * P[1][k];
        for (int r = 2; r < 4; r++)
            for (int k = 0; k < N; k++) P[r][k] += T * P[r + 2][k] + h * P[r + 4][k];
        for (int r = 4; r < 6; r++)
            for (int k = 0; k < N; k++) P[r][k] += T * P[r + 2][k];
        for (int r = 0; r < N; r++) {
            P[r][0] += T * P[r][1];
            for (int k = 2; k < 4; k++) P[r][k] += T * P[r][k + 2] + h * P[r][k + 4];
            for (int k = 4; k < 6; k++) P[r][k] += T * P[r][k + 2];
        }
        const double k0 = known ? b0 : 0.0, k1 = known ? b1 : 0.0, q = known ? ru : 1.0;
        for (int k = 0; k < N; k++) {
            P[0][k] += k0 * c[k];
            P[1][k] += k1 * c[k];
        }
        for (int k = 0; k < N; k++) {
            P[k][0] += k0 * c[k];
            P[k][1] += k1 * c[k];
        }
        P[0][0] += k0 * k0 * spread + b0 * b0 * q;
        P[0][1] += k0 * k1 * spread + b0 * b1 * q;
        P[1][0] += k0 * k1 * spread + b0 * b1 * q;
        P[1][1] += k1 * k1 * spread + b1 * b1 * q;
        const double e = seen ? z - x[1] : 0.0;
        factor = fabs(e) > theta ? fmin(largest, factor + up) : fmax(1.0, factor - down);
        double s[N];
        for (int k = 0; k < N; k++) s[k] = sqrt(fmin(factor, fmax(cap[k] / fmax(P[k][k], 1e-300), 1.0)));
        for (int r = 0; r < N; r++)
            for (int k = 0; k < N; k++) P[r][k] *= s[r] * s[k];
        double nis = -1;
        if (seen) {
            const double S = P[1][1] + rv;
            double column[N], gain[N];
            for (int k = 0; k < N; k++) {
                column[k] = P[k][1];
                gain[k] = column[k] / S;
            }
            for (int r = 0; r < N; r++)
                for (int k = 0; k < N; k++) P[r][k] -= gain[r] * column[k];
            for (int k = 0; k < N; k++) {
                P[1][k] = P[k][1] = column[k] * (rv / S);
                x[k] += gain[k] * e;
            }
            nis = e * e / S;
        }
        for (int r = 1; r < N; r++) /* fading would let the antisymmetric rounding errors grow */
            for (int k = 0; k < r; k++) P[r][k] = P[k][r];
        before = samples[3 * i];
        outputs[4 * i] = x[2];
        outputs[4 * i + 1] = x[3];
        outputs[4 * i + 2] = x[0];
        outputs[4 * i + 3] = nis;
    }
    memcpy(state, x, sizeof x);
    memcpy(state + N, P, sizeof P);
    state[72] = before;
    state[74] = factor;
}
