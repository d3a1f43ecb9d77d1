/* How a filter on the inertial process begins: from a guess or a fit, and after a pause. */

static const double RESUME_STD = 1e-4; /* [m], what a carry-over by the measured position adds */

static void place_start(palpate_filter *f, const palpate_reading *r, const double *first, const double *std)
{
    double *mean = f->state + AT_MEAN, *covariance = f->state + AT_COVARIANCE;
    for (int i = 0; i < PALPATE_STATE; i++) {
        f->state[i] = 0.0;
    }
    for (int i = 0; i < STATES; i++) {
        mean[i] = first[i];
        covariance[i * (STATES + 1)] = std[i] * std[i];
    }
    mean[AT_RATE] = isfinite(r->velocity) ? -r->velocity : 0.0;
    f->state[AT_FACTOR] = 1.0;
}

/* State for a stretch of contact after another, by the measured position; 0 where the tip is above the surface. */
static int resume(palpate_filter *f, const palpate_reading *r)
{
    double *mean = f->state + AT_MEAN, *covariance = f->state + AT_COVARIANCE, held[PALPATE_STATE];
    const double depth = f->carried_surface - r->position;
    for (int i = 0; i < PALPATE_STATE; i++) {
        held[i] = f->state[i];
    }
    place_start(f, r, f->settings.step.start, f->settings.step.start_std);
    if (!(depth > 0.0)) {
        return 0;
    }
    for (int i = 2; i < STATES; i++) {
        mean[i] = held[AT_MEAN + i];
        for (int j = 2; j < STATES; j++) {
            covariance[i * STATES + j] = held[AT_COVARIANCE + i * STATES + j];
        }
    }
    mean[AT_DEPTH] = depth;
    covariance[AT_DEPTH * (STATES + 1)] = held[AT_COVARIANCE + AT_DEPTH * (STATES + 1)] + RESUME_STD * RESUME_STD;
    return 1;
}

#if FITTABLE
OPENING
#endif

enum { LENIENT = 0 };

/* State from the first reading and a fit where there is one, else from the guess. */
static void begin(palpate_filter *f, const palpate_reading *first, const palpate_start_fit *found)
{
    const palpate_step_settings *step = &f->settings.step;
#if FITTABLE
    if (found) {
        double mean[STATES], std[STATES];
        for (int i = 0; i < STATES; i++) {
            mean[i] = step->start[i];
            std[i] = step->start_std[i];
        }
        mean[AT_DEPTH] = found->surface - first->position;
        const double depth_std = FIT_SPREAD * found->surface_std;
        std[AT_DEPTH] = depth_std < std[AT_DEPTH] ? depth_std : std[AT_DEPTH];
        for (int i = 0; i < PALPATE_PARAMETERS; i++) {
            const double wide = FIT_SPREAD * found->theta_std[i];
            mean[AT_CHART + i] = found->theta[i];
            if (wide > 0.0 && wide < std[AT_CHART + i]) {
                std[AT_CHART + i] = wide;
            }
        }
        place_start(f, first, mean, std);
        return;
    }
#endif
    (void)found;
    place_start(f, first, step->start, step->start_std);
}

static void inputs_of(const palpate_reading *r, double interval, double *inputs)
{
    inputs[0] = r->force;
    inputs[1] = -r->velocity;
    inputs[2] = interval;
}
