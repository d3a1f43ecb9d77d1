/* The paper's filter with the paraboloid, written by hand: what the compiled kernel is measured against.
   State: mean (4), covariance (16, columns). Sample: force, rate, interval. Settings: sigma_u, sigma_vel, mass,
   kappa per elasticity, lambda per viscosity. Output: elasticity, viscosity, depth, NIS. Same order of events and the
   same guards as the filter in palpate_filters, without marks and restarts. */
#include <math.h>
#include <string.h>

void run(long count, double *state, const double *samples, const double *settings, double *outputs) {
    double x[4], P[16], before = state[20];
    const double ru = settings[0] * settings[0], rv = settings[1] * settings[1];
    const double m = settings[2], ck = settings[3], cl = settings[4];
    memcpy(x, state, sizeof x);
    memcpy(P, state + 4, sizeof P);
    for (long i = 0; i < count; i++) {
        const double u = before, z = samples[3 * i + 1], T = samples[3 * i + 2];
        const double b0 = T * T / (2 * m), b1 = T / m;
        const double d = x[0], inside = d > 0, root = sqrt(inside ? d : 1.0);
        const double away = sqrt(inside ? (d > 1e-5 ? d : 1e-5) : 1.0);
        const double fe = inside ? ck * root * d : 0, fv = inside ? cl * root * x[1] : 0;
        const double force = fe * x[2] + fv * x[3];
        const int known = fabs(u) <= 1e300;
        const double excess = (known ? u : force) - force, q = known ? ru : 1.0;
        const double ad = inside ? (d > 1e-5 ? d : 1e-5) : 0;
        double g[4];
        g[0] = inside ? 1.5 * ck * away * x[2] + 0.5 * cl * x[1] * x[3] / away : 0;
        g[1] = inside ? cl * away * x[3] : 0;
        g[2] = inside ? ck * away * ad : 0;
        g[3] = inside ? cl * away * x[1] : 0;
        double F[16] = {0}; /* rows */
        for (int j = 0; j < 4; j++) {
            F[j] = known ? -b0 * g[j] : 0;
            F[4 + j] = known ? -b1 * g[j] : 0;
        }
        F[0] += 1; F[1] += T; F[5] += 1; F[10] = 1; F[15] = 1;
        x[0] = d + T * x[1] + b0 * excess;
        x[1] += b1 * excess;
        double A[16], C[16];
        for (int r = 0; r < 2; r++)
            for (int c = 0; c < 4; c++) {
                double sum = 0;
                for (int k = 0; k < 4; k++) sum += F[4 * r + k] * P[4 * c + k];
                A[4 * r + c] = sum;
            }
        for (int c = 0; c < 4; c++) { A[8 + c] = P[4 * c + 2]; A[12 + c] = P[4 * c + 3]; }
        for (int r = 0; r < 4; r++) {
            for (int c = 0; c < 2; c++) {
                double sum = 0;
                for (int k = 0; k < 4; k++) sum += A[4 * r + k] * F[4 * c + k];
                C[4 * r + c] = sum;
            }
            C[4 * r + 2] = A[4 * r + 2];
            C[4 * r + 3] = A[4 * r + 3];
        }
        C[0] += b0 * b0 * q; C[1] += b0 * b1 * q; C[4] += b0 * b1 * q; C[5] += b1 * b1 * q;
        double nis = -1;
        if (fabs(z) <= 1e300) {
            const double S = C[5] + rv, e = z - x[1];
            double K[4];
            for (int r = 0; r < 4; r++) K[r] = C[4 * r + 1] / S;
            double D[16];
            for (int r = 0; r < 4; r++)
                for (int c = 0; c < 4; c++) D[4 * r + c] = C[4 * r + c] - K[r] * C[4 + c];
            for (int r = 0; r < 4; r++)
                for (int c = 0; c < 4; c++) C[4 * r + c] = D[4 * r + c] - D[4 * r + 1] * K[c] + K[r] * K[c] * rv;
            for (int r = 0; r < 4; r++) x[r] += K[r] * e;
            nis = e * e / S;
        }
        for (int r = 0; r < 4; r++)
            for (int c = 0; c < 4; c++) P[4 * c + r] = 0.5 * (C[4 * r + c] + C[4 * c + r]);
        before = samples[3 * i];
        outputs[4 * i] = x[2]; outputs[4 * i + 1] = x[3]; outputs[4 * i + 2] = x[0]; outputs[4 * i + 3] = nis;
    }
    memcpy(state, x, sizeof x);
    memcpy(state + 4, P, sizeof P);
    state[20] = before;
}
