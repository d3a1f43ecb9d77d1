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

enum { STEP = 50 }; /* readings looked at are counted: a step of the filter costs so much */

static void advance(palpate_filter *f, const palpate_reading *r, double interval, double *output)
{
    f->share -= STEP;
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

/* Hold a reading; 0 where it is full. */
static int hold(palpate_filter *f, const palpate_reading *r, int begins)
{
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
        return 0;
    }
    f->window[f->held] = *r;
    f->window[f->held++].touch = begins;
    return 1;
}

/* Start where what is held is enough, and run over it; report only what is now. */
static int gather(palpate_filter *f, const palpate_reading *r, int begins, palpate_estimate *e)
{
    palpate_gathering *g = &f->gathering;
    double output[OUTPUTS];
    int fitted = 0;
    RESUME(g)
    if (!hold(f, r, begins)) {
        LEAVE(g, PALPATE_NO_ROOM);
    }
    e->status = PALPATE_IDLE | PALPATE_WAITING;
    g->elapsed = r->time - f->window[0].time - f->gaps;
    while (g->elapsed >= f->settings.window * (1.0 + 0.2 * f->attempts) - 1e-9) {
#if FITTABLE
        AWAIT(g, fitted, fit_start(f, f->held, LENIENT && f->attempts >= ATTEMPTS, &f->fit.found));
        if (!fitted && f->attempts < ATTEMPTS) {
            f->attempts++;
            continue;
        }
#endif
        begin(f, f->window, fitted ? &f->fit.found : 0);
        for (g->i = 0; g->i < f->held; g->i++) {
            PAUSE_IF_DONE(f, g);
            const palpate_reading *one = &f->window[g->i];
            if (one->touch && g->i > 0) {
                resume(f, one);
            }
            advance(f, one, one->touch ? 0.0 : one->interval, output);
        }
        f->started = 1;
        read_output(f, r, output, e);
        break;
    }
    END(g, 0);
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
        begin(f, r, 0);
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
    RESUME(&f->delivery)
    e->time = r.time;
    e->contact = contact;
    e->status = PALPATE_IDLE;
    for (int i = 0; i < PALPATE_PARAMETERS; i++) {
        e->value[i] = e->std[i] = NAN;
    }
    e->surface = e->surface_std = e->force = e->nis = e->innovation = NAN;
    f->share -= 4;
    if (contact && r.measuring) {
        AWAIT(&f->delivery, failed, track(f, &r, e));
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
    END(&f->delivery, failed);
}

/* Nothing asks any more for the oldest so many readings of the record. */
static void forget(palpate_filter *f, int count)
{
    f->oldest = (f->oldest + count) % PALPATE_RECORD;
    f->count -= count;
    f->released -= count;
    f->seen -= f->seen < count ? f->seen : count;
    f->shown -= f->shown < count ? f->shown + 1 : count;
    f->begins -= f->begins < count ? f->begins : count;
}

/* Go on with the readings in the record, as far as their share of work goes; 0, BUSY, or an error. */
static int catch_up(palpate_filter *f)
{
    const double settled = f->settings.tare_duration + f->settings.touch_lag;
    int answer = 0;
    RESUME(f)
    if (f->phase == PALPATE_TARING) {
        const double newest = reading_at(f, f->count - 1)->time;
        if (f->settings.tare_measured ? !(newest > settled) : f->count < FIRST) {
            LEAVE(f, 0);
        }
        AWAIT(f, answer, settle(f));
        if (answer) {
            LEAVE(f, answer);
        }
        f->phase = PALPATE_IN_AIR;
    }
    while (f->phase == PALPATE_IN_AIR) {
        if (f->seen == f->count) {
            LEAVE(f, 0);
        }
        PAUSE_IF_DONE(f, f);
        AWAIT(f, answer, touch_shows(f, f->seen));
        if (answer) {
            f->shown = f->seen;
            f->phase = PALPATE_SHOWN;
            break;
        }
        f->seen++;
        if (f->settings.tare_measured && reading_at(f, f->seen - 1)->time <= settled) {
            continue; /* a touch here is looked for from the beginning on */
        }
        while (f->released < f->seen - f->lag) {
            PAUSE_IF_DONE(f, f);
            answer = deliver(f, reading_at(f, f->released++), 0);
            if (answer) {
                LEAVE(f, answer);
            }
        }
        if (f->released > f->baseline) {
            forget(f, f->released - f->baseline);
        }
    }
    if (f->phase == PALPATE_SHOWN) {
        if (f->count <= f->shown + f->after) {
            LEAVE(f, 0);
        }
        AWAIT(f, answer, touch_began(f, f->shown, f->shown + 1 + f->after, &f->begins, &f->touch.surface));
        forget(f, f->released);
        f->touch.in_contact = 1;
        f->phase = PALPATE_TOUCHED;
    }
    while (f->count > 0) {
        PAUSE_IF_DONE(f, f);
        const palpate_reading *r = reading_at(f, 0);
        f->contact = f->begins == 0 &&
                     (f->shown >= 0 || in_contact(f, &f->touch, r->time, tared(f, r->force), r->position));
        AWAIT(f, answer, deliver(f, reading_at(f, 0), f->contact));
        if (answer) {
            LEAVE(f, answer);
        }
        f->released = 1;
        forget(f, 1);
    }
    END(f, 0);
}

int palpate_start(palpate_filter *f, const palpate_settings *settings)
{
    typedef char step_settings_are_doubles[sizeof(palpate_step_settings) == STEP_SETTINGS * sizeof(double) ? 1 : -1];
    (void)sizeof(step_settings_are_doubles);
    for (unsigned char *byte = (unsigned char *)f, *end = (unsigned char *)(f + 1); byte < end; byte++) {
        *byte = 0;
    }
    f->settings = *settings;
    f->phase = PALPATE_TARING;
#if PALPATE_WINDOW > 0
    const double longest = settings->window * 4.0 * PALPATE_RATE;
    if (longest > PALPATE_WINDOW) {
        f->phase = PALPATE_FAILED;
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
    if (f->phase == PALPATE_FAILED) {
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
    if (f->count == PALPATE_RECORD) {
        failed = PALPATE_NO_ROOM;
    } else {
        f->record[(f->oldest + f->count++) % PALPATE_RECORD] = r;
        f->share = f->settings.share > 0 ? f->settings.share : INT_MAX;
        failed = catch_up(f);
    }
    if (failed && failed != BUSY) {
        f->phase = PALPATE_FAILED;
        return f->failure = failed;
    }
    if (f->made > 0) {
        *latest = f->latest;
    }
    return f->made;
}
