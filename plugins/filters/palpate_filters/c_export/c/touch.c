/* Tare and touch, as in palpate's alignment. */

/* A search of many samples is shared out: where a sample has done its share, the function answers BUSY, and goes on from
 * the same line with the next (protothreads: Dunkels, Schmidt, Voigt and Ali 2006). What it needs then is in its job. */
enum { BUSY = -100 };
#define RESUME(job) switch ((job)->line) { case 0:
#define PAUSE_IF_DONE(f, job) do { if ((f)->share <= 0) { (job)->line = __LINE__; return BUSY; case __LINE__:; } } while (0)
#define AWAIT(job, answer, call) \
    do { (job)->line = __LINE__; if (0) { case __LINE__:; } (answer) = (call); if ((answer) == BUSY) return BUSY; } while (0)
#define LEAVE(job, answer) do { (job)->line = 0; return (answer); } while (0)
#define END(job, answer) } LEAVE(job, answer)

static const int IN_A_ROW = 3;           /* samples that must agree before contact is found or lost */
static const double PAPER_NOISE = 0.05;  /* [N] without free air to measure it in */
static const double TOUCH_SIGMAS = 5.0;
static const double LEAST_TOUCH = 0.05;  /* [N] */
static const double LEAST_RISE = 0.03;   /* [N] of a tenth of a second's mean */
static const double BELIEVED = 0.1;      /* of the rise: what the law of a change point may leave */
static const double NEAR_TOUCH = 3.0;    /* touch forces, up to which contact is looked at */
static const double AFTER = 0.2;         /* of the lag */
static const double BASELINE = 1.0;      /* [s] of air against which the begin of contact is detected */
static const int FIRST = 11;             /* samples, from which the interval is taken */
static const double WANDER = 0.02;       /* [N]; less is drift */
static const int FEWEST_TARE = 10;       /* samples */

static const palpate_reading *reading_at(const palpate_filter *f, int i)
{
    return &f->record[(f->oldest + i) % PALPATE_RECORD];
}

static double tared(const palpate_filter *f, double force)
{
    return force - f->tare + f->settings.weight;
}

typedef struct {
    double surface, rms, rise;
} change;

enum { CHANGE_GRID = 41, CHANGE_LEVELS = 4, CHANGE_PARTS = 8, CHANGE_MOST = 4000, CHANGE_FEWEST = 20 };

/* Of the readings from `first` to `end`, the first of every `step` whose numbers are known. */
static int next_known(const palpate_filter *f, const palpate_search *s, int i, int *known)
{
    for (; i < s->end; i++) {
        const palpate_reading *r = reading_at(f, i);
        if (isfinite(r->position) && isfinite(r->force) && (*known)++ % s->step == 0) {
            return i;
        }
    }
    return i;
}

static double power_of_depth(double depth)
{
    return depth > 0.0 ? depth * sqrt(depth) : 0.0;
}

/* Sum of squares that is left for a height; the total where the force would fall with depth. */
static double left_over(palpate_filter *f, const palpate_search *s, double height, double *shape_mean, double *slope)
{
    double sum = 0.0, square = 0.0, product = 0.0, rest = 0.0;
    int known = 0, count = 0;
    for (int i = next_known(f, s, s->first, &known); i < s->end; i = next_known(f, s, i + 1, &known)) {
        const palpate_reading *r = reading_at(f, i);
        const double shape = power_of_depth(height - r->position), force = tared(f, r->force) - s->mean;
        sum += shape;
        square += shape * shape;
        product += shape * force;
        rest += force;
        count++;
    }
    f->share -= s->end - s->first;
    *shape_mean = sum / count;
    square -= sum * *shape_mean;
    product -= *shape_mean * rest;
    *slope = square > 0.0 ? product / square : 0.0;
    return square > 0.0 && product > 0.0 ? s->total - product * product / square : s->total;
}

/* How many samples count as one, from the scatter of the means of eighths. */
static double hanging_together(const palpate_filter *f, const palpate_search *s, double offset, double slope)
{
    double parts = 0.0, square = 0.0;
    int known = 0, i = next_known(f, s, s->first, &known);
    for (int part = 0; part < CHANGE_PARTS; part++) {
        const int length = s->count / CHANGE_PARTS + (part < s->count % CHANGE_PARTS ? 1 : 0);
        double sum = 0.0;
        for (int k = 0; k < length; k++, i = next_known(f, s, i + 1, &known)) {
            const palpate_reading *r = reading_at(f, i);
            const double rest = tared(f, r->force) - offset - slope * power_of_depth(s->surface - r->position);
            sum += rest;
            square += rest * rest;
        }
        parts += (sum / length) * (sum / length);
    }
    const double together = parts / CHANGE_PARTS * s->count / CHANGE_PARTS / (square / s->count);
    return square > 0.0 && together > 1.0 ? together : 1.0;
}

/* Range, mean and sum of squares of the readings; 0 where there are too few, or none moves. */
static int survey(palpate_filter *f, palpate_search *s)
{
    int known = 0;
    s->step = 1;
    s->count = 0;
    for (int i = next_known(f, s, s->first, &known); i < s->end; i = next_known(f, s, i + 1, &known)) {
        s->count++;
    }
    if (s->count < CHANGE_FEWEST) {
        return 0;
    }
    s->step = (s->count + CHANGE_MOST - 1) / CHANGE_MOST;
    s->top = -HUGE_VAL;
    s->bottom = HUGE_VAL;
    s->mean = s->total = 0.0;
    known = s->count = 0;
    for (int i = next_known(f, s, s->first, &known); i < s->end; i = next_known(f, s, i + 1, &known)) {
        const palpate_reading *r = reading_at(f, i);
        s->top = r->position > s->top ? r->position : s->top;
        s->bottom = r->position < s->bottom ? r->position : s->bottom;
        s->mean += tared(f, r->force);
        s->count++;
    }
    s->mean /= s->count;
    known = 0;
    for (int i = next_known(f, s, s->first, &known); i < s->end; i = next_known(f, s, i + 1, &known)) {
        const double force = tared(f, reading_at(f, i)->force) - s->mean;
        s->total += force * force;
    }
    f->share -= 3 * (s->end - s->first);
    return s->top - s->bottom >= 2e-5;
}

/* F = b for z >= z_s, b + c (z_s - z)^1.5 below; 0 where a constant force explains the readings as well. */
static int change_point(palpate_filter *f, int first, int end, change *found)
{
    palpate_search *s = &f->search;
    double shape_mean, slope;
    RESUME(s)
    s->first = first;
    s->end = end;
    if (!survey(f, s)) {
        LEAVE(s, 0);
    }
    s->left = s->total;
    s->surface = s->high = s->top;
    s->low = s->bottom;
    for (s->level = 0; s->level < CHANGE_LEVELS; s->level++) {
        s->least = HUGE_VAL;
        s->at = 0;
        for (s->k = 0; s->k < CHANGE_GRID; s->k++) {
            PAUSE_IF_DONE(f, s);
            const double step = (s->high - s->low) / (CHANGE_GRID - 1);
            const double height = s->k < CHANGE_GRID - 1 ? s->low + s->k * step : s->high;
            const double rest = left_over(f, s, height, &shape_mean, &slope);
            if (rest < s->least) {
                s->least = rest;
                s->at = s->k;
            }
        }
        const double step = (s->high - s->low) / (CHANGE_GRID - 1);
        const double height = s->at < CHANGE_GRID - 1 ? s->low + s->at * step : s->high;
        if (s->least < s->left || (s->least == s->left && height < s->surface)) {
            s->left = s->least;
            s->surface = height;
        }
        s->high = s->at < CHANGE_GRID - 2 ? s->low + (s->at + 1) * step : s->high;
        s->low = s->at > 0 ? s->low + (s->at - 1) * step : s->low;
    }
    PAUSE_IF_DONE(f, s);
    left_over(f, s, s->surface, &shape_mean, &slope);
    const double noise = (s->left > 0.0 ? s->left : 0.0) / (s->count - 3), offset = s->mean - slope * shape_mean;
    if (s->surface - s->bottom < 2e-5 || s->total - s->left <= 25.0 * noise * hanging_together(f, s, offset, slope)) {
        LEAVE(s, 0);
    }
    found->surface = s->surface;
    found->rms = sqrt(noise);
    found->rise = slope * power_of_depth(s->surface - s->bottom);
    END(s, 1);
}

/* Whether readings scatter within their sixths rather than wandering from one to the next. */
static int at_rest(const palpate_filter *f, int end, int count)
{
    double means[6], within = 0.0, mean = 0.0, between = 0.0;
    int i = 0;
    for (int part = 0; part < 6; part++) {
        const int length = count / 6 + (part < count % 6 ? 1 : 0);
        double sum = 0.0, square = 0.0;
        const int begin = i;
        for (int k = 0; k < length && i < end; i++) {
            if (isfinite(reading_at(f, i)->force)) {
                sum += reading_at(f, i)->force;
                k++;
            }
        }
        means[part] = sum / length;
        for (int j = begin; j < i; j++) {
            const double apart = reading_at(f, j)->force - means[part];
            square += isfinite(apart) ? apart * apart : 0.0;
        }
        within += sqrt(square / length) / 6.0;
        mean += means[part] / 6.0;
    }
    for (int part = 0; part < 6; part++) {
        between += (means[part] - mean) * (means[part] - mean) / 6.0;
    }
    between = sqrt(between);
    return between <= WANDER || between <= 1.5 * within;
}

/* The mean force before a reading, of so many known forces, and their scatter; 0, or an error. */
static int take_tare(palpate_filter *f, int end, int count)
{
    double sum = 0.0, lost = 0.0, square = 0.0;
    for (int i = 0; i < end; i++) { /* with what rounding loses, so that the sum is rounded once (Neumaier 1974) */
        const double x = isfinite(reading_at(f, i)->force) ? reading_at(f, i)->force : 0.0, next = sum + x;
        lost += fabs(sum) >= fabs(x) ? sum - next + x : x - next + sum;
        sum = next;
    }
    sum += lost;
    for (int i = 0; i < end; i++) {
        const double apart = reading_at(f, i)->force - sum / count;
        square += isfinite(apart) ? apart * apart : 0.0;
    }
    f->share -= 4 * end;
    if (!at_rest(f, end, count)) {
        return PALPATE_NOT_AT_REST;
    }
    f->tare = sum / count;
    f->tare_noise = sqrt(square / (count - 1));
    return 0;
}

/* The tare from what is before a time [s] of the first tare_duration, and of no contact within; 0, or an error. */
static int measure_tare(palpate_filter *f, double before)
{
    palpate_taring *t = &f->taring;
    const double ends = before < f->settings.tare_duration ? before : f->settings.tare_duration;
    int changes = 0;
    change found;
    RESUME(t)
    t->end = t->count = 0;
    for (; t->end < f->count && reading_at(f, t->end)->time <= ends && reading_at(f, t->end)->time < before; t->end++) {
        t->count += isfinite(reading_at(f, t->end)->force) ? 1 : 0;
    }
    f->tare = 0.0;
    f->tare_noise = 0.0;
    if (t->count < FEWEST_TARE) {
        LEAVE(t, 0);
    }
    t->weight = f->settings.weight;
    f->settings.weight = 0.0; /* the raw force */
    AWAIT(t, changes, change_point(f, 0, t->end, &found));
    f->settings.weight = t->weight;
    if (changes) { /* contact is what lies below the surface without interruption up to the end of the window */
        int below = 0, all = 1, last = t->end;
        for (int i = t->end - 1; i >= 0; i--) {
            const palpate_reading *r = reading_at(f, i);
            if (isfinite(r->force)) {
                if (r->position < found.surface) {
                    below++;
                    last = i;
                } else {
                    all = 0;
                    break;
                }
            }
        }
        if (!all && t->count - below >= FEWEST_TARE) {
            t->count -= below;
            t->end = last;
        }
    }
    PAUSE_IF_DONE(f, t);
    END(t, take_tare(f, t->end, t->count));
}

static void moments(const double *values, int count, double *mean, double *square, int *known)
{
    double sum = 0.0;
    *known = 0;
    for (int i = 0; i < count; i++) {
        if (isfinite(values[i])) {
            sum += values[i];
            (*known)++;
        }
    }
    *mean = sum / (*known > 1 ? *known : 1);
    *square = 0.0;
    for (int i = 0; i < count; i++) {
        if (isfinite(values[i])) {
            *square += (values[i] - *mean) * (values[i] - *mean);
        }
    }
    *square /= *known > 2 ? *known - 1 : 1;
}

/* Whether the average of the latest 100 ms is above its baseline, a second that ends half a second before. */
static int risen(const palpate_rise *rise)
{
    enum { OLD = 100, PART = 10, NOW = 10 };
    double baseline[OLD], parts[OLD / PART], mean, square, other, scatter, now = 0.0, steps = 0.0;
    int known, few, pairs = 0;
    const int missing = PALPATE_RISE_BLOCKS - rise->blocks;
    for (int i = 0; i < OLD; i++) { /* the oldest 100 of 160 blocks */
        baseline[i] = i < missing ? NAN : rise->means[(rise->newest + 1 + i) % PALPATE_RISE_BLOCKS];
    }
    moments(baseline, OLD, &mean, &square, &known);
    for (int part = 0; part < OLD / PART; part++) {
        double sum = 0.0;
        for (int i = 0; i < PART; i++) {
            sum += baseline[part * PART + i];
        }
        parts[part] = sum / PART;
    }
    moments(parts, OLD / PART, &other, &scatter, &few);
    for (int i = 1; i < OLD; i++) {
        const double step = baseline[i] - baseline[i - 1];
        if (isfinite(step)) {
            steps += step * step;
            pairs++;
        }
    }
    const double white = steps / (2.0 * (pairs > 1 ? pairs : 1));
    const double shared = square - 1.5 * white, uneven = (shared > 0.0 ? shared : 0.0) + white / NOW;
    double level = TOUCH_SIGMAS * sqrt(scatter > uneven ? scatter : uneven);
    level = level > LEAST_RISE ? level : LEAST_RISE;
    for (int i = 0; i < NOW; i++) {
        now += rise->means[(rise->newest + PALPATE_RISE_BLOCKS - i) % PALPATE_RISE_BLOCKS];
    }
    return known >= 50 && rise->blocks >= NOW && now / NOW - mean > level;
}

static int rise_lasts(palpate_filter *f, palpate_rise *rise, double force)
{
    rise->sum += force;
    if (++rise->count < rise->samples) {
        return 0;
    }
    rise->newest = (rise->newest + 1) % PALPATE_RISE_BLOCKS;
    rise->means[rise->newest] = rise->sum / rise->samples;
    rise->blocks += rise->blocks < PALPATE_RISE_BLOCKS ? 1 : 0;
    rise->sum = 0.0;
    rise->count = 0;
    rise->lasting = risen(rise) ? rise->lasting + 1 : 0;
    f->share -= PALPATE_RISE_BLOCKS;
    if (rise->lasting >= 10) {
        rise->lasting = 0;
        return 1;
    }
    return 0;
}

static double touch_threshold(const palpate_filter *f)
{
    if (f->settings.touch_force > 0.0) {
        return f->settings.touch_force;
    }
    const double level = TOUCH_SIGMAS * (f->tare_noise > 0.0 ? f->tare_noise : PAPER_NOISE);
    return level > LEAST_TOUCH ? level : LEAST_TOUCH;
}

/* Force that counts as touch at a time: a tenth of the threshold is for drift. */
static double touch_limit(const palpate_filter *f, const palpate_touch *touch, double time)
{
    const double level = 0.9 * touch->threshold + f->settings.drift * time;
    return level > touch->threshold ? level : touch->threshold;
}

static void touch_begin(const palpate_filter *f, palpate_touch *touch, double interval)
{
    touch->above = touch->below = touch->over = touch->in_contact = touch->doubtful = 0;
    touch->surface = touch->rise.sum = 0.0;
    touch->rise.count = touch->rise.blocks = touch->rise.lasting = 0;
    touch->line = 0;
    touch->threshold = touch_threshold(f);
    touch->rising = f->settings.touch_force <= 0.0 && f->lag > 0;
    touch->rise.samples = 1;
    if (interval > 0.0 && rint(0.01 / interval) > 1.0) {
        touch->rise.samples = (int)rint(0.01 / interval);
    }
    touch->rise.newest = PALPATE_RISE_BLOCKS - 1;
}

/* The first reading that nobody has been given when touch showed. */
static int earliest(const palpate_filter *f, int shown)
{
    const double settled = f->settings.tare_duration + f->settings.touch_lag;
    if (f->settings.tare_measured && reading_at(f, shown)->time <= settled) {
        return 0;
    }
    return shown > f->lag ? shown - f->lag : 0;
}

/* The change point in the baseline, what is looked back over, and what is held up to `end`. */
static int touch_change(palpate_filter *f, int shown, int end, change *found)
{
    const int first = earliest(f, shown) - f->baseline;
    const int changes = f->lag > 0 ? change_point(f, first > 0 ? first : 0, end, found) : 0;
    return changes == 1 ? found->rms < 2.0 * f->touch.threshold / TOUCH_SIGMAS + BELIEVED * found->rise : changes;
}

/* Whether touch shows at a reading. */
static int touch_shows(palpate_filter *f, int i)
{
    palpate_touch *touch = &f->touch;
    const double force = tared(f, reading_at(f, i)->force);
    int lasts, changes = 0;
    change found;
    RESUME(touch)
    f->share -= 4;
    touch->above = force > touch_limit(f, touch, reading_at(f, i)->time) ? touch->above + 1 : 0;
    lasts = touch->rising && rise_lasts(f, &touch->rise, force);
    if (touch->above >= IN_A_ROW || !lasts) {
        LEAVE(touch, touch->above >= IN_A_ROW);
    }
    AWAIT(touch, changes, touch_change(f, i, i + 1, &found));
    touch->doubtful = touch->doubtful || changes;
    END(touch, changes);
}

/* Where contact began that showed at a reading; whether a change point said so. */
static int touch_began(palpate_filter *f, int shown, int end, int *begin, double *surface)
{
    int stop = end < shown + 1 + f->after ? end : shown + 1 + f->after, above = 0;
    for (int i = shown; i < stop; i++) {
        above = tared(f, reading_at(f, i)->force) > NEAR_TOUCH * f->touch.threshold ? above + 1 : 0;
        if (above >= IN_A_ROW) {
            stop = i;
        }
    }
    change found;
    *begin = shown;
    *surface = reading_at(f, shown)->position;
    const int changes = touch_change(f, shown, stop, &found);
    if (changes != 1) {
        return changes;
    }
    const int first = earliest(f, shown);
    *begin = first;
    for (int i = shown; i >= first; i--) {
        if (reading_at(f, i)->position >= found.surface) {
            *begin = i + 1 < shown ? i + 1 : shown;
            break;
        }
    }
    *surface = found.surface;
    return 1;
}

static double median_interval(const palpate_filter *f)
{
    double sorted[16];
    int count = 0;
    for (int i = 1; i < FIRST && i < f->count; i++) {
        int k = count++;
        for (; k > 0 && sorted[k - 1] > reading_at(f, i)->interval; k--) {
            sorted[k] = sorted[k - 1];
        }
        sorted[k] = reading_at(f, i)->interval;
    }
    if (count == 0) {
        return 0.0;
    }
    return count % 2 ? sorted[count / 2] : (sorted[count / 2 - 1] + sorted[count / 2]) / 2.0;
}

/* Settle lag and tare on the beginning of the record; 0, or an error. */
static int settle(palpate_filter *f)
{
    palpate_settling *s = &f->settling;
    const double interval = median_interval(f);
    const int lag = interval > 0.0 ? (int)(f->settings.touch_lag / interval) : 0;
    int answer = 0, begin;
    double surface;
    RESUME(s)
    f->after = (int)(AFTER * lag);
    f->lag = lag - f->after;
    f->baseline = interval > 0.0 ? (int)(BASELINE / interval) : 0;
    f->tare = f->settings.tare_offset;
    f->tare_noise = 0.0;
    if (f->baseline + f->lag + f->after + 2 > PALPATE_RECORD) {
        LEAVE(s, PALPATE_NO_ROOM);
    }
    if (f->settings.tare_measured) {
        AWAIT(s, answer, measure_tare(f, HUGE_VAL));
        if (answer) {
            LEAVE(s, answer);
        }
        for (s->head = 0; s->head < f->count; s->head++) {
            if (!(reading_at(f, s->head)->time <= f->settings.tare_duration + f->settings.touch_lag)) {
                break;
            }
        }
        touch_begin(f, &f->touch, interval); /* a trial */
        for (s->i = 0; f->lag > 0 && s->i < s->head; s->i++) {
            PAUSE_IF_DONE(f, s);
            AWAIT(s, answer, touch_shows(f, s->i));
            if (answer) {
                AWAIT(s, answer, touch_began(f, s->i, s->head, &begin, &surface));
                s->before = answer ? reading_at(f, begin)->time : HUGE_VAL;
                if (s->before < f->settings.tare_duration) {
                    AWAIT(s, answer, measure_tare(f, s->before));
                    if (answer) {
                        LEAVE(s, answer);
                    }
                }
                break;
            }
        }
    }
    touch_begin(f, &f->touch, interval);
    END(s, 0);
}

/* After the first touch: hysteresis, on after some samples in a row above the threshold, off after as many below half
 * of it. After a touch detected by a rise, it is off only where the tip is above the surface again, until the force has
 * passed the threshold once. */
static int in_contact(const palpate_filter *f, palpate_touch *touch, double time, double force, double position)
{
    const double limit = touch_limit(f, touch, time);
    touch->above = force > limit ? touch->above + 1 : 0;
    touch->below = force < limit - 0.5 * touch->threshold ? touch->below + 1 : 0;
    if (touch->doubtful) {
        touch->over = position > touch->surface ? touch->over + 1 : 0;
        if (touch->above >= IN_A_ROW || touch->over >= IN_A_ROW) {
            touch->in_contact = touch->above >= IN_A_ROW;
            touch->doubtful = 0;
        }
    } else if (touch->above >= IN_A_ROW) {
        touch->in_contact = 1;
    } else if (touch->below >= IN_A_ROW) {
        touch->in_contact = 0;
    }
    return touch->in_contact;
}
