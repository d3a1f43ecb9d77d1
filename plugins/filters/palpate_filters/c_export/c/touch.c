/* Tare and touch, as in palpate's alignment. */

enum { TARING, IN_AIR, SHOWN, TOUCHED, FAILED };

static const int IN_A_ROW = 3;           /* samples that must agree before contact is found or lost */
static const double PAPER_NOISE = 0.05;  /* [N] where there is no free air to measure it in */
static const double TOUCH_SIGMAS = 5.0;
static const double LEAST_TOUCH = 0.05;  /* [N] */
static const double LEAST_RISE = 0.03;   /* [N] of a tenth of a second's mean */
static const double BELIEVED = 0.1;      /* of the rise: what the law of a change point may leave */
static const double NEAR_TOUCH = 3.0;    /* touch forces, up to which contact is looked at */
static const double AFTER = 0.2;         /* of the lag */
static const double BASELINE = 1.0;      /* [s] of air that the begin of contact is told from */
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

/* Readings that a change point is looked for in; the first of every `step` whose numbers are known. */
typedef struct {
    const palpate_filter *f;
    int first, end, step;
} stretch;

static int next_known(const stretch *s, int i, int *known)
{
    for (; i < s->end; i++) {
        const palpate_reading *r = reading_at(s->f, i);
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
static double left_over(const stretch *s, double mean, double total, double height, double *shape_mean, double *slope)
{
    double sum = 0.0, square = 0.0, product = 0.0, rest = 0.0;
    int known = 0, count = 0;
    for (int i = next_known(s, s->first, &known); i < s->end; i = next_known(s, i + 1, &known)) {
        const palpate_reading *r = reading_at(s->f, i);
        const double shape = power_of_depth(height - r->position), force = tared(s->f, r->force) - mean;
        sum += shape;
        square += shape * shape;
        product += shape * force;
        rest += force;
        count++;
    }
    *shape_mean = sum / count;
    square -= sum * *shape_mean;
    product -= *shape_mean * rest;
    *slope = square > 0.0 ? product / square : 0.0;
    return square > 0.0 && product > 0.0 ? total - product * product / square : total;
}

/* How many samples count as one, from the scatter of the means of eighths. */
static double hanging_together(const stretch *s, int count, double offset, double slope, double height)
{
    double parts = 0.0, square = 0.0;
    int known = 0, i = next_known(s, s->first, &known);
    for (int part = 0; part < CHANGE_PARTS; part++) {
        const int length = count / CHANGE_PARTS + (part < count % CHANGE_PARTS ? 1 : 0);
        double sum = 0.0;
        for (int k = 0; k < length; k++, i = next_known(s, i + 1, &known)) {
            const palpate_reading *r = reading_at(s->f, i);
            const double rest = tared(s->f, r->force) - offset - slope * power_of_depth(height - r->position);
            sum += rest;
            square += rest * rest;
        }
        parts += (sum / length) * (sum / length);
    }
    const double together = parts / CHANGE_PARTS * count / CHANGE_PARTS / (square / count);
    return square > 0.0 && together > 1.0 ? together : 1.0;
}

/* F = b for z >= z_s, b + c (z_s - z)^1.5 below; 0 where a constant force explains the readings as well. */
static int change_point(const palpate_filter *f, int first, int end, change *found)
{
    stretch s = {f, first, end, 1};
    int known = 0, count = 0;
    for (int i = next_known(&s, first, &known); i < end; i = next_known(&s, i + 1, &known)) {
        count++;
    }
    if (count < CHANGE_FEWEST) {
        return 0;
    }
    s.step = (count + CHANGE_MOST - 1) / CHANGE_MOST;
    double top = -HUGE_VAL, bottom = HUGE_VAL, mean = 0.0, total = 0.0;
    known = count = 0;
    for (int i = next_known(&s, first, &known); i < end; i = next_known(&s, i + 1, &known)) {
        const palpate_reading *r = reading_at(f, i);
        top = r->position > top ? r->position : top;
        bottom = r->position < bottom ? r->position : bottom;
        mean += tared(f, r->force);
        count++;
    }
    mean /= count;
    if (top - bottom < 2e-5) {
        return 0;
    }
    known = 0;
    for (int i = next_known(&s, first, &known); i < end; i = next_known(&s, i + 1, &known)) {
        const double force = tared(f, reading_at(f, i)->force) - mean;
        total += force * force;
    }
    double left = total, surface = top, low = bottom, high = top, shape_mean, slope;
    for (int level = 0; level < CHANGE_LEVELS; level++) {
        const double step = (high - low) / (CHANGE_GRID - 1);
        double least = HUGE_VAL;
        int at = 0;
        for (int k = 0; k < CHANGE_GRID; k++) {
            const double height = k < CHANGE_GRID - 1 ? low + k * step : high;
            const double rest = left_over(&s, mean, total, height, &shape_mean, &slope);
            if (rest < least) {
                least = rest;
                at = k;
            }
        }
        const double height = at < CHANGE_GRID - 1 ? low + at * step : high;
        if (least < left || (least == left && height < surface)) {
            left = least;
            surface = height;
        }
        high = at < CHANGE_GRID - 2 ? low + (at + 1) * step : high;
        low = at > 0 ? low + (at - 1) * step : low;
    }
    left_over(&s, mean, total, surface, &shape_mean, &slope);
    const double noise = (left > 0.0 ? left : 0.0) / (count - 3), offset = mean - slope * shape_mean;
    if (surface - bottom < 2e-5 || total - left <= 25.0 * noise * hanging_together(&s, count, offset, slope, surface)) {
        return 0;
    }
    found->surface = surface;
    found->rms = sqrt(noise);
    found->rise = slope * power_of_depth(surface - bottom);
    return 1;
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

/* The tare from what is before a time [s] of the first tare_duration, and of no contact within; 0, or an error. */
static int measure_tare(palpate_filter *f, double before)
{
    const double ends = before < f->settings.tare_duration ? before : f->settings.tare_duration;
    int end = 0, count = 0;
    for (; end < f->count && reading_at(f, end)->time <= ends && reading_at(f, end)->time < before; end++) {
        count += isfinite(reading_at(f, end)->force) ? 1 : 0;
    }
    f->tare = 0.0;
    f->tare_noise = 0.0;
    if (count < FEWEST_TARE) {
        return 0;
    }
    change found;
    const double weight = f->settings.weight;
    f->settings.weight = 0.0; /* the raw force */
    const int changes = change_point(f, 0, end, &found);
    f->settings.weight = weight;
    if (changes) { /* contact is what lies below the surface without interruption up to the end of the window */
        int below = 0, all = 1, last = end;
        for (int i = end - 1; i >= 0; i--) {
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
        if (!all && count - below >= FEWEST_TARE) {
            count -= below;
            end = last;
        }
    }
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
    if (!at_rest(f, end, count)) {
        return PALPATE_NOT_AT_REST;
    }
    f->tare = sum / count;
    f->tare_noise = sqrt(square / (count - 1));
    return 0;
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

static int rise_lasts(palpate_rise *rise, double force)
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
static int touch_change(const palpate_filter *f, const palpate_touch *touch, int shown, int end, change *found)
{
    if (f->lag == 0) {
        return 0;
    }
    const int first = earliest(f, shown) - f->baseline;
    if (!change_point(f, first > 0 ? first : 0, end, found)) {
        return 0;
    }
    return found->rms < 2.0 * touch->threshold / TOUCH_SIGMAS + BELIEVED * found->rise;
}

/* Whether touch shows at a reading. */
static int touch_shows(const palpate_filter *f, palpate_touch *touch, int i)
{
    const double force = tared(f, reading_at(f, i)->force);
    touch->above = force > touch_limit(f, touch, reading_at(f, i)->time) ? touch->above + 1 : 0;
    const int lasts = touch->rising && rise_lasts(&touch->rise, force);
    if (touch->above >= IN_A_ROW) {
        return 1;
    }
    change found;
    if (lasts && touch_change(f, touch, i, i + 1, &found)) {
        touch->doubtful = 1;
        return 1;
    }
    return 0;
}

/* Where contact began that showed at a reading; whether a change point said so. */
static int touch_began(const palpate_filter *f, const palpate_touch *touch, int shown, int end, int *begin,
                       double *surface)
{
    int stop = end < shown + 1 + f->after ? end : shown + 1 + f->after, above = 0;
    for (int i = shown; i < stop; i++) {
        above = tared(f, reading_at(f, i)->force) > NEAR_TOUCH * touch->threshold ? above + 1 : 0;
        if (above >= IN_A_ROW) {
            stop = i;
        }
    }
    change found;
    *begin = shown;
    *surface = reading_at(f, shown)->position;
    if (!touch_change(f, touch, shown, stop, &found)) {
        return 0;
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
    const double interval = median_interval(f);
    const int lag = interval > 0.0 ? (int)(f->settings.touch_lag / interval) : 0;
    f->after = (int)(AFTER * lag);
    f->lag = lag - f->after;
    f->baseline = interval > 0.0 ? (int)(BASELINE / interval) : 0;
    f->tare = f->settings.tare_offset;
    f->tare_noise = 0.0;
    if (f->baseline + f->lag + f->after + 2 > PALPATE_RECORD) {
        return PALPATE_NO_ROOM;
    }
    if (f->settings.tare_measured) {
        int failed = measure_tare(f, HUGE_VAL), head = 0, begin;
        double surface;
        if (failed) {
            return failed;
        }
        while (head < f->count && reading_at(f, head)->time <= f->settings.tare_duration + f->settings.touch_lag) {
            head++;
        }
        touch_begin(f, &f->touch, interval); /* a trial */
        for (int i = 0; f->lag > 0 && i < head; i++) {
            if (touch_shows(f, &f->touch, i)) {
                if (touch_began(f, &f->touch, i, head, &begin, &surface) &&
                    reading_at(f, begin)->time < f->settings.tare_duration) {
                    failed = measure_tare(f, reading_at(f, begin)->time);
                }
                break;
            }
        }
        if (failed) {
            return failed;
        }
    }
    touch_begin(f, &f->touch, interval);
    return 0;
}

/* After the first touch: hysteresis, on after some samples in a row above the threshold, off after as many below half
 * of it. After a touch that a rise told, it is off only where the tip is above the surface again, until the force has
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
