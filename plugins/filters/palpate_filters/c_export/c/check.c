/* Feeds the filter with the samples of vectors.csv and compares every estimate with palpate's; then takes its time. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "palpate_filter.h"

enum { IN = 7, OUT = 2 * PALPATE_PARAMETERS + 6, LINE = 1024 };
static const double TOLERANCE = 1e-12;

typedef struct {
    FILE *expected;
    long compared, bad;
    double largest, largest_at, force_std;
    int largest_column, wrong_status, compares;
} comparison;

static int numbers(FILE *file, double *found, long long *stamp, int count)
{
    char line[LINE], *at = line;
    if (fgets(line, sizeof line, file) == 0) {
        return 0;
    }
    *stamp = strtoll(at, &at, 10);
    for (int i = 0; i < count; i++) {
        found[i] = strtod(at + 1, &at);
    }
    return 1;
}

static void compare(void *context, const palpate_estimate *e)
{
    comparison *c = context;
    double row[IN - 1 + OUT], found[OUT - 1];
    long long stamp;
    int n = 0;
    if (!numbers(c->expected, row, &stamp, IN - 1 + OUT)) {
        c->bad++;
        return;
    }
    const double *expected = row + IN - 1;
    for (int i = 0; i < PALPATE_PARAMETERS; i++) {
        found[n++] = e->value[i];
    }
    for (int i = 0; i < PALPATE_PARAMETERS; i++) {
        found[n++] = e->std[i];
    }
    const double others[] = {e->surface, e->surface_std, e->force, e->nis, e->innovation};
    memcpy(found + n, others, sizeof others);
    /* Relative to the number itself; of heights to a millimetre at least, of forces to a newton, and of surprises,
     * which are differences of readings over their noise, to that of a newton. */
    const double newton = 1.0 / c->force_std, floors[] = {1e-3, 0.0, 1.0, newton, newton};
    c->compared++;
    if ((uint32_t)expected[OUT - 1] != e->status) {
        if (c->wrong_status++ == 0) {
            printf("status %u instead of %u at %.4f s\n", (unsigned)e->status, (unsigned)expected[OUT - 1], e->time);
        }
    }
    for (int i = 0; i < OUT - 1; i++) {
        const double least = i < 2 * PALPATE_PARAMETERS ? 0.0 : floors[i - 2 * PALPATE_PARAMETERS];
        const double size = fabs(expected[i]) > least ? fabs(expected[i]) : least;
        const double apart = fabs(found[i] - expected[i]);
        const int neither = isnan(found[i]) && isnan(expected[i]);
        const double error = neither || apart == 0.0 ? 0.0 : apart / size;
        if (!(error <= TOLERANCE)) {
            c->bad++;
        }
        if (!(error <= c->largest)) {
            c->largest = error;
            c->largest_at = e->time;
            c->largest_column = i;
        }
    }
}

static palpate_filter filter;
enum { TARE, AIR, TOUCH, START, CONTACT, KINDS, MOST = 1 << 16, PASSES = 9 };
static const char *const KIND[] = {"tare", "free air", "touch", "start", "contact"};
static double times[MOST]; /* of each sample, the shortest of all passes: what interrupts one does not count */
static int kinds[MOST];

/* What the next sample is for. */
static int kind_of(const palpate_filter *f)
{
    return f->phase == PALPATE_TARING ? TARE
           : f->phase == PALPATE_IN_AIR && f->search.line == 0 ? AIR
           : f->phase != PALPATE_TOUCHED ? TOUCH
           : f->started ? CONTACT : START;
}

/* What a function of yours counts (-DPALPATE_COUNTER=its_name), cycles where they can be read, else nanoseconds. */
#if defined(PALPATE_COUNTER)
static const char *UNIT = "counts";
double PALPATE_COUNTER(void);
static double now(void)
{
    return PALPATE_COUNTER();
}
#elif defined(__x86_64__) && defined(__GNUC__)
static const char *UNIT = "cycles";
static double now(void)
{
    return (double)__builtin_ia32_rdtsc();
}
#else
static const char *UNIT = "ns";
static double now(void)
{
    return 1e9 * (double)clock() / CLOCKS_PER_SEC;
}
#endif

static int sample_of(FILE *file, palpate_sample *sample)
{
    double row[IN - 1];
    long long stamp;
    if (!numbers(file, row, &stamp, IN - 1)) {
        return 0;
    }
    sample->stamp = stamp;
    sample->force = row[0];
    sample->position = row[1];
    sample->velocity = row[2];
    sample->lateral_x = row[3];
    sample->lateral_y = row[4];
    sample->measuring = row[5] > 0.5;
    return 1;
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Feed all samples; their number, or what the filter answered. */
static long feed(FILE *file, const palpate_settings *settings, comparison *c)
{
    char heading[LINE];
    palpate_sample sample;
    palpate_estimate latest;
    long samples = 0;
    int answer = palpate_start(&filter, settings);
    filter.listener = c->compares ? compare : 0;
    filter.context = c;
    rewind(file);
    rewind(c->expected);
    if (fgets(heading, sizeof heading, file) == 0 || fgets(heading, sizeof heading, c->expected) == 0) {
        return -1;
    }
    while (answer >= 0 && sample_of(file, &sample)) {
        const long i = samples++ % MOST;
        kinds[i] = kind_of(&filter);
        const double before = now();
        answer = palpate_feed(&filter, &sample, &latest);
        const double took = now() - before;
        times[i] = took < times[i] ? took : times[i];
    }
    if (answer < 0) {
        printf("the filter answers %d at sample %ld\n", answer, samples);
    }
    return answer < 0 ? answer : samples;
}

/* The middle and the slowest sample of each kind. */
static void print_times(long samples)
{
    static double own[MOST];
    for (int kind = 0; kind < KINDS; kind++) {
        int count = 0;
        for (long i = 0; i < samples && i < MOST; i++) {
            if (kinds[i] == kind) {
                own[count++] = times[i];
            }
        }
        if (count > 0) {
            qsort(own, (size_t)count, sizeof own[0], by_size);
            printf("%-8s %5d samples, %s: %.0f the median, %.0f the slowest\n", KIND[kind], count, UNIT,
                   own[count / 2], own[count - 1]);
        }
    }
}

int main(int count, char **arguments)
{
    const char *path = count > 1 ? arguments[1] : "vectors.csv";
    FILE *file = fopen(path, "r");
    comparison c = {fopen(path, "r"), 0, 0, 0.0, 0.0, 0.05, 0, 0, 1};
    palpate_settings settings;
    if (file == 0 || c.expected == 0) {
        printf("%s: cannot be read\n", path);
        return 2;
    }
    palpate_defaults(&settings);
    c.force_std = settings.step.force_std;
    const int share = settings.share;
    settings.share = 0; /* at once: every sample has its estimate */
    const long samples = feed(file, &settings, &c);
    if (samples < 0) {
        return 1;
    }
    const long compared = c.compared;
    settings.share = share; /* in shares: the same estimates, some of them later */
    if (feed(file, &settings, &c) < 0) {
        return 1;
    }
    printf("%ld of %ld samples have an estimate, %ld in shares; largest difference %.2g (column %d of %s, at %.4f s)\n",
           compared, samples, c.compared - compared, c.largest, c.largest_column + IN + 1, path, c.largest_at);
    if (c.bad || c.wrong_status || compared == 0 || c.compared == compared) {
        printf("%ld numbers differ by more than %g, and %d status words\n", c.bad, TOLERANCE, c.wrong_status);
        return 1;
    }
    c.compares = 0;
    for (int i = 0; i < MOST; i++) {
        times[i] = HUGE_VAL;
    }
    for (int pass = 0; pass < PASSES; pass++) {
        feed(file, &settings, &c);
    }
    print_times(samples);
    printf("%.1f kB of memory\n", (double)sizeof(palpate_filter) / 1e3);
    fclose(file);
    fclose(c.expected);
    return 0;
}
