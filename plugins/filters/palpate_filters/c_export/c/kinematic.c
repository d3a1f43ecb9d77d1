/* How the kinematic filter begins: from a fit or a guess, and after a pause. */

static void place_motion(palpate_filter *f, const palpate_reading *r, double position_std, double velocity_std)
{
    double *mean = f->state + AT_MEAN, *covariance = f->state + AT_COVARIANCE;
    const int moving = isfinite(r->velocity);
    const double std[3] = {position_std, moving ? velocity_std : 0.1, ACCELERATION_STD};
    const double first[3] = {r->position, moving ? r->velocity : 0.0, 0.0};
    for (int i = 0; i < 3; i++) {
        mean[i] = first[i];
        for (int j = 0; j < STATES; j++) {
            covariance[i * STATES + j] = covariance[j * STATES + i] = 0.0;
        }
        covariance[i * STATES + i] = std[i] * std[i];
    }
    f->state[AT_LOW] = 0.0;
}

/* State for a stretch of contact after another: motion reset, surface and material as they were. */
static int resume(palpate_filter *f, const palpate_reading *r)
{
    place_motion(f, r, 5e-6, 1e-3);
    return 1;
}

#if BIASED
static double bias_variance(const palpate_filter *f, double elapsed)
{
    const palpate_start_settings *start = &f->settings.start;
    const double drifted = start->drift * elapsed, walked = start->drift_walk * start->drift_walk * elapsed;
    const double grown = drifted * drifted + walked;
    return start->bias_std * start->bias_std + (grown > 1e-12 ? grown : 1e-12);
}
#endif

#if FITTABLE
#if BIASED
static double bias_std(const palpate_filter *f, double elapsed)
{
    return sqrt(bias_variance(f, elapsed));
}
#endif

OPENING

/* Covariance after a fit: with a bias from all that the fit says of it, else of each number alone. */
static void take_fit(palpate_filter *f, const palpate_start_fit *found)
{
    double *covariance = f->state + AT_COVARIANCE;
#if BIASED
    double whole[MATRIX * MATRIX], units[MATRIX];
    for (int i = 0; i < STATES; i++) {
        units[i] = sqrt(covariance[i * (STATES + 1)]);
    }
    for (int i = 0; i < STATES * STATES; i++) {
        whole[i] = covariance[i] / (units[i / STATES] * units[i % STATES]);
    }
    if (!invert(whole, STATES)) {
        return;
    }
    for (int i = 0; i < UNKNOWNS; i++) {
        const int a = i == 0 ? AT_SURFACE : i == UNKNOWNS - 1 ? AT_BIAS : AT_CHART + i - 1;
        for (int j = 0; j < UNKNOWNS; j++) {
            const int b = j == 0 ? AT_SURFACE : j == UNKNOWNS - 1 ? AT_BIAS : AT_CHART + j - 1;
            whole[a * STATES + b] += found->information[i * UNKNOWNS + j] / (FIT_SPREAD * FIT_SPREAD) *
                                     (units[a] * units[b]);
        }
    }
    if (!invert(whole, STATES)) {
        return;
    }
    for (int i = 0; i < STATES * STATES; i++) {
        covariance[i] = whole[i] * (units[i / STATES] * units[i % STATES]);
    }
#else
    const palpate_start_settings *start = &f->settings.start;
    const double widest = 2.0 * start->start_depth, std = FIT_SPREAD * found->surface_std;
    covariance[AT_SURFACE * (STATES + 1)] = std < widest ? std * std : widest * widest;
    for (int i = 0; i < PALPATE_PARAMETERS; i++) {
        double relative = start->start_spread;
        if (found->theta_std[i] > 0.0) {
            relative = FIT_SPREAD * found->theta_std[i] / fabs(found->theta[i]);
            relative = relative > 1e-3 ? relative : 1e-3;
            relative = relative < start->start_spread ? relative : start->start_spread;
        }
        covariance[(AT_CHART + i) * (STATES + 1)] = relative * relative;
    }
#endif
}
#endif

enum { LENIENT = 1 }; /* in the end, with a parameter that the fit has at zero */

/* State from the first reading and a fit where there is one, else from the guess. */
static void begin(palpate_filter *f, const palpate_reading *first, const palpate_start_fit *found)
{
    double *mean = f->state + AT_MEAN, *covariance = f->state + AT_COVARIANCE;
    const palpate_start_settings *start = &f->settings.start;
    for (int i = 0; i < PALPATE_STATE; i++) {
        f->state[i] = 0.0;
    }
    for (int i = 3; i < STATES; i++) {
        const int chart = i >= AT_CHART && i < AT_CHART + PALPATE_PARAMETERS;
        const double std = i == AT_SURFACE ? 2.0 * start->start_depth
                           : chart         ? start->start_spread
                           : i == AT_SLOPE ? start->slope_std
                           : i == AT_TREND ? start->trend_std
                                           : 1.0;
        covariance[i * (STATES + 1)] = std * std;
    }
    mean[AT_SURFACE] = first->position + start->start_depth;
    place_motion(f, first, start->position_std, start->velocity_std);
#if BIASED
    covariance[AT_BIAS * (STATES + 1)] = bias_variance(f, first->time);
#if DRIFTING
    const double drift = start->drift * start->drift;
    covariance[AT_DRIFT * (STATES + 1)] = drift;
    covariance[AT_BIAS * STATES + AT_DRIFT] = covariance[AT_DRIFT * STATES + AT_BIAS] = drift * first->time;
#endif
#endif
#if FITTABLE
    if (found) {
        mean[AT_SURFACE] = found->surface;
        take_fit(f, found);
        chart_of(found->theta, mean + AT_CHART);
#if BIASED
        mean[AT_BIAS] = f->state[AT_CENTRE] = found->bias;
#endif
        return;
    }
#endif
    (void)found;
    chart_of(start->guess, mean + AT_CHART);
}

static void inputs_of(const palpate_reading *r, double interval, double *inputs)
{
    inputs[0] = r->force;
    inputs[1] = r->position;
    inputs[2] = r->velocity;
    inputs[3] = interval;
}
