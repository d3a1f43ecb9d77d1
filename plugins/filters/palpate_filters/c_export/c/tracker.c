/* The tracker: starts the filter, carries it over pauses, reads its outputs; then the whole way of a sample. */

#if PALPATE_AIR > 0
/* Learn the noise from free air before the first contact. */
static void listen(palpate_filter *f, const palpate_reading *r)
{
    f->air_newest = (f->air_newest + 1) % PALPATE_AIR;
    f->air_force[f->air_newest] = r->force;
    f->air_velocity[f->air_newest] = r->velocity;
    f->air_count += f->air_count < PALPATE_AIR ? 1 : 0;
    if (r->time < f->settings.standstill) {
        const double values[2] = {r->force, r->velocity};
        for (int i = 0; i < 2; i++) {
            if (isfinite(values[i])) { /* Welford 1962 */
                const double apart = values[i] - f->still_mean[i];
                f->still_mean[i] += apart / ++f->still_count[i];
                f->still_square[i] += apart * (values[i] - f->still_mean[i]);
            }
        }
        if (isfinite(r->position)) {
            f->still_low = f->still_count[2] && f->still_low < r->position ? f->still_low : r->position;
            f->still_high = f->still_count[2] && f->still_high > r->position ? f->still_high : r->position;
            f->still_count[2]++;
        }
    }
}

/* From second differences, in which slow motion and drift drop out; 0 where there are too few. */
static double from_curvature(const palpate_filter *f, const double *air)
{
    double square = 0.0;
    int known = 0;
    for (int i = 2; i < f->air_count; i++) {
        const int at = f->air_newest + PALPATE_AIR - (f->air_count - 1) + i;
        const double last = air[at % PALPATE_AIR] - air[(at - 1) % PALPATE_AIR];
        const double curvature = last - (air[(at - 1) % PALPATE_AIR] - air[(at - 2) % PALPATE_AIR]);
        if (isfinite(curvature)) {
            square += curvature * curvature;
            known++;
        }
    }
    return known >= 50 ? sqrt(square / known / 6.0) : 0.0;
}

static int settle_noise(palpate_filter *f)
{
    double force = 0.0, velocity = 0.0;
    const int still = f->still_count[0] >= 50 && f->still_count[1] >= 50 && f->still_count[2] >= 50;
    if (still && f->still_high - f->still_low <= 1e-4) {
        force = sqrt(f->still_square[0] / (f->still_count[0] - 1));
        velocity = sqrt(f->still_square[1] / (f->still_count[1] - 1));
    } else {
        force = from_curvature(f, f->air_force);
        velocity = from_curvature(f, f->air_velocity);
    }
    f->settings.step.force_std = force;
    f->settings.step.velocity_std = velocity;
    f->noise_known = 1;
    return force > 0.0 && velocity > 0.0 ? 0 : PALPATE_NO_NOISE;
}
#endif

static void advance(palpate_filter *f, const palpate_reading *r, double interval, double *output)
{
    double inputs[INPUTS];
    inputs_of(r, interval, inputs);
    step(f->state, inputs, (const double *)(const void *)&f->settings.step, f->state, output);
    f->carried_surface = r->position + output[OUT_DEPTH];
    f->diverged = f->diverged || output[OUT_DIVERGED] > 0.5;
}

static void read_output(const palpate_filter *f, const palpate_reading *r, const double *output, palpate_estimate *e)
{
    static const struct {
        int at;
        uint32_t status;
    } marks[] = {{OUT_LIFTED, PALPATE_LIFTED}, {OUT_RESTARTED, PALPATE_RESTARTED}, {OUT_BLIND, PALPATE_BLIND},
                 {OUT_STIFF, PALPATE_STIFF},   {OUT_REPAIRED, PALPATE_REPAIRED}};
    e->status = f->diverged ? PALPATE_DIVERGED : 0;
    for (unsigned i = 0; i < sizeof marks / sizeof marks[0]; i++) {
        e->status |= output[marks[i].at] > 0.5 ? marks[i].status : 0;
    }
    if (f->diverged) {
        return;
    }
    for (int i = 0; i < PALPATE_PARAMETERS; i++) {
        const double variance = output[OUT_VARIANCES + i];
        e->value[i] = output[OUT_VALUES + i];
        e->std[i] = sqrt(variance > 0.0 ? variance : 0.0);
    }
    e->surface = r->position + output[OUT_DEPTH];
    e->surface_std = sqrt(output[OUT_DEPTH_VARIANCE] > 0.0 ? output[OUT_DEPTH_VARIANCE] : 0.0);
    e->force = output[OUT_FORCE];
    e->nis = output[OUT_NIS] < 0.0 ? NAN : output[OUT_NIS];
    e->innovation = output[OUT_INNOVATION] == 0.0 ? NAN : output[OUT_INNOVATION];
}

#if PALPATE_WINDOW > 0
static const double ELSEWHERE = 1e-3; /* [m] along the surface: a touch there says nothing of the height here */
enum { ATTEMPTS = 15 };

/* Hold a reading until there are enough to start on; then run over them, and tell only what is now. */
static int gather(palpate_filter *f, const palpate_reading *r, int begins, palpate_estimate *e)
{
    double output[OUTPUTS];
    if (begins && f->held > 0) {
        const palpate_reading *last = &f->window[f->held - 1];
        const double x = r->lateral_x - last->lateral_x, y = r->lateral_y - last->lateral_y;
        if (sqrt(x * x + y * y) > ELSEWHERE) {
            f->held = f->attempts = 0;
            f->gaps = 0.0;
        } else {
            f->gaps += r->time - last->time;
        }
    }
    if (f->held == PALPATE_WINDOW) {
        return PALPATE_NO_ROOM;
    }
    f->window[f->held] = *r;
    f->window[f->held++].touch = begins;
    e->status = PALPATE_IDLE | PALPATE_WAITING;
    const double elapsed = r->time - f->window[0].time - f->gaps;
    while (elapsed >= f->settings.window * (1.0 + 0.2 * f->attempts) - 1e-9) {
        if (!begin(f, f->window, f->held, f->attempts < ATTEMPTS)) {
            f->attempts++;
            continue;
        }
        for (int i = 0; i < f->held; i++) {
            const palpate_reading *one = &f->window[i];
            if (one->touch && i > 0) {
                resume(f, one);
            }
            advance(f, one, one->touch ? 0.0 : one->interval, output);
        }
        f->started = 1;
        read_output(f, r, output, e);
        break;
    }
    return 0;
}
#endif

static int track(palpate_filter *f, const palpate_reading *r, palpate_estimate *e)
{
    double output[OUTPUTS];
    const int begins = !f->active || r->interval > PAUSE;
    int resumed = 0;
#if PALPATE_AIR > 0
    if (!f->noise_known) {
        const int failed = settle_noise(f);
        if (failed) {
            return failed;
        }
    }
#endif
#if PALPATE_WINDOW > 0
    if (!f->started && f->settings.window > 0.0) {
        return gather(f, r, begins, e);
    }
#endif
    if (!f->started) {
        begin(f, r, 0, 0);
        f->started = 1;
    } else if (begins) {
        resumed = resume(f, r);
    }
    advance(f, r, begins ? 0.0 : r->interval, output);
    read_output(f, r, output, e);
    e->status |= resumed ? PALPATE_RESUMED : 0;
    return 0;
}

/* A reading of which it is known whether it is in contact: its estimate; 0, or an error. */
static int deliver(palpate_filter *f, const palpate_reading *raw, int contact)
{
    palpate_estimate *e = &f->latest;
    palpate_reading r = *raw;
    int failed = 0;
    r.force = tared(f, raw->force);
    e->time = r.time;
    e->contact = contact;
    e->status = PALPATE_IDLE;
    for (int i = 0; i < PALPATE_PARAMETERS; i++) {
        e->value[i] = e->std[i] = NAN;
    }
    e->surface = e->surface_std = e->force = e->nis = e->innovation = NAN;
    if (contact && r.measuring) {
        failed = track(f, &r, e);
        f->active = 1;
    } else {
#if PALPATE_AIR > 0
        if (!f->noise_known && !contact) {
            listen(f, &r);
        }
#endif
        f->active = 0;
    }
    f->made++;
    if (f->listener) {
        f->listener(f->context, e);
    }
    return failed;
}

/* Give away what is before a reading of the record, none of it in contact. */
static int release(palpate_filter *f, int before)
{
    int failed = 0;
    while (f->released < before && !failed) {
        failed = deliver(f, reading_at(f, f->released++), 0);
    }
    while (f->released > f->baseline && f->phase == IN_AIR) {
        f->oldest = (f->oldest + 1) % PALPATE_RECORD;
        f->count--;
        f->released--;
        f->shown--;
    }
    return failed;
}

/* What was held back, marked from where contact began. */
static int touched(palpate_filter *f)
{
    int begin_at, failed;
    touch_began(f, &f->touch, f->shown, f->count, &begin_at, &f->touch.surface);
    f->touch.in_contact = 1;
    failed = release(f, begin_at);
    for (; f->released < f->count && !failed; f->released++) {
        const palpate_reading *r = reading_at(f, f->released);
        const int contact = f->released <= f->shown || in_contact(f, &f->touch, r->time, tared(f, r->force), r->position);
        failed = deliver(f, r, contact);
    }
    f->phase = TOUCHED;
    return failed;
}

/* What the newest reading says before the first touch is told. */
static int before_touch(palpate_filter *f)
{
    int i = f->count - 1;
    if (f->phase == TARING) {
        const double settled = f->settings.tare_duration + f->settings.touch_lag;
        if (f->settings.tare_measured ? !(reading_at(f, i)->time > settled) : f->count < FIRST) {
            return 0;
        }
        const int failed = settle(f);
        if (failed) {
            return failed;
        }
        f->phase = IN_AIR;
        i = 0;
    }
    for (; f->phase == IN_AIR && i < f->count; i++) {
        if (touch_shows(f, &f->touch, i)) {
            f->phase = SHOWN;
            f->shown = i;
        }
    }
    if (f->phase == IN_AIR) {
        return release(f, f->count - f->lag);
    }
    return f->count > f->shown + f->after ? touched(f) : 0;
}

int palpate_start(palpate_filter *f, const palpate_settings *settings)
{
    typedef char step_settings_are_doubles[sizeof(palpate_step_settings) == STEP_SETTINGS * sizeof(double) ? 1 : -1];
    (void)sizeof(step_settings_are_doubles);
    for (unsigned char *byte = (unsigned char *)f, *end = (unsigned char *)(f + 1); byte < end; byte++) {
        *byte = 0;
    }
    f->settings = *settings;
    f->phase = TARING;
#if PALPATE_WINDOW > 0
    const double longest = settings->window * 4.0 * PALPATE_RATE;
    if (longest > PALPATE_WINDOW) {
        f->phase = FAILED;
        return f->failure = PALPATE_NO_ROOM;
    }
#endif
    return 0;
}

int palpate_feed(palpate_filter *f, const palpate_sample *sample, palpate_estimate *latest)
{
    palpate_reading r = {0.0, 0.0, sample->force, sample->position, sample->velocity, sample->lateral_x,
                         sample->lateral_y, sample->measuring, 0};
    int failed = 0;
    if (f->phase == FAILED) {
        return f->failure;
    }
    if (!f->fed) {
        f->origin = f->previous = sample->stamp;
        f->fed = 1;
    } else if (sample->stamp <= f->previous) {
        return PALPATE_OUT_OF_ORDER;
    }
    r.time = (double)(sample->stamp - f->origin) / 1e9;
    r.interval = (double)(sample->stamp - f->previous) / 1e9;
    f->previous = sample->stamp;
    f->made = 0;
    if (f->phase == TOUCHED) {
        failed = deliver(f, &r, in_contact(f, &f->touch, r.time, tared(f, r.force), r.position));
    } else if (f->count == PALPATE_RECORD) {
        failed = PALPATE_NO_ROOM;
    } else {
        f->record[(f->oldest + f->count++) % PALPATE_RECORD] = r;
        failed = before_touch(f);
    }
    if (failed) {
        f->phase = FAILED;
        return f->failure = failed;
    }
    if (f->made > 0) {
        *latest = f->latest;
    }
    return f->made;
}
