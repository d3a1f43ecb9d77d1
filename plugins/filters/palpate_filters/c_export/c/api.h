/* One sample: what force, height and velocity are at one instant. NaN says that a reading is missing. */
typedef struct {
    int64_t stamp;    /* [ns] of any clock; each later than the one before */
    double force;     /* [N] as the sensor reads it, positive where the tip is pushed out */
    double position;  /* [m] height of the tip, positive out of the material */
    double velocity;  /* [m/s] of that height */
    double lateral_x; /* [m] along the surface; NaN where nobody knows */
    double lateral_y; /* [m] */
    int measuring;    /* 0 where the motion is not meant for estimation */
} palpate_sample;

/* What the status of an estimate says, bit by bit; 0 where nothing is amiss. */
enum {
    PALPATE_IDLE = 1,      /* not tracking: out of contact, or not measuring */
    PALPATE_LIFTED = 2,    /* the estimated depth is not positive although the tip is in contact */
    PALPATE_RESTARTED = 4, /* restarted here: the depth had stayed at or below zero */
    PALPATE_DIVERGED = 8,  /* the numbers are not plausible any more: nothing after this can be used */
    PALPATE_BLIND = 16,    /* a measurement is missing: predicted only */
    PALPATE_STIFF = 32,    /* the contact is too stiff for the time step */
    PALPATE_RESUMED = 64,  /* carried over a gap, or a second touch, by the measured position */
    PALPATE_WAITING = 128, /* gathering samples to start on */
    PALPATE_REPAIRED = 256 /* the covariance had lost its positivity to rounding, and was repaired */
};

/* What can go wrong, as the negative answers of palpate_start and palpate_feed. All but the first are final. */
enum {
    PALPATE_OUT_OF_ORDER = -1, /* a stamp that is not later than the one before; the sample is left out */
    PALPATE_NOT_AT_REST = -2,  /* the force wanders over tare_duration, so that no tare is known */
    PALPATE_NO_ROOM = -3,      /* more samples than there is memory for: see PALPATE_RECORD and PALPATE_WINDOW */
    PALPATE_NO_NOISE = -4      /* too little free air to measure the noise in */
};

/* One estimate; NaN before the first. */
typedef struct {
    double time;                      /* [s] since the first sample */
    double value[PALPATE_PARAMETERS]; /* the parameters of the contact model, in SI units */
    double std[PALPATE_PARAMETERS];   /* standard deviation of each */
    double surface;                   /* [m] height of the untouched surface */
    double surface_std;               /* [m] */
    double force;                     /* [N] contact force of the model */
    double nis;                       /* normalised innovation squared; 1 on average where model and noise are right */
    double innovation;                /* over its own standard deviation, with its sign */
    uint32_t status;                  /* PALPATE_... */
    int contact;                      /* the tip touches the material */
} palpate_estimate;

/* What may be set. palpate_defaults gives what the pipeline said. */
typedef struct {
    int tare_measured;    /* 1: the tare is the mean of the first tare_duration in free air; 0: it is tare_offset */
    double tare_offset;   /* [N] */
    double tare_duration; /* [s] */
    double touch_lag;     /* [s] that samples are held back until the first touch, to find where contact began */
    double touch_force;   /* [N] that counts as touch; 0: five standard deviations of the free air */
    double drift;         /* [N/s] that the zero may drift by, which touch_force grows by */
    double weight;        /* [N] that is added to the tared force */
    double standstill;    /* [s] at the beginning in which the tip is known to hang still; negative: unknown */
    double window;        /* [s] of contact that the filter starts on; 0: it starts at once, from the guess */
    int share;            /* readings that the work of one sample may look at, before the next goes on with it; 0: all */
    palpate_start_settings start;
    palpate_step_settings step;
} palpate_settings;

/* From here to the end of palpate_filter: nothing that a caller needs. */
typedef struct {
    double time, interval, force, position, velocity, lateral_x, lateral_y;
    int measuring, touch;
} palpate_reading;

typedef struct {
    double sum, means[PALPATE_RISE_BLOCKS];
    int samples, count, blocks, newest, lasting;
} palpate_rise;

enum { PALPATE_TARING, PALPATE_IN_AIR, PALPATE_SHOWN, PALPATE_TOUCHED, PALPATE_FAILED };

/* Work that many samples share, and the line at which the next goes on with it. */
typedef struct {
    int line, first, end, step, count, level, k, at;
    double top, bottom, mean, total, left, surface, low, high, least;
} palpate_search;

typedef struct {
    int line, end, count;
    double weight;
} palpate_taring;

typedef struct {
    int line, head, i;
    double before;
} palpate_settling;

#if PALPATE_WINDOW > 0
typedef struct {
    int calls;
    double a, b, x, second, third, fx, f_second, f_third, step, before, u;
} palpate_minimum;

typedef struct {
    double surface, surface_std, bias;
    double theta[PALPATE_PARAMETERS], theta_std[PALPATE_PARAMETERS]; /* the latter 0 where it was not fitted */
    double information[(2 + PALPATE_PARAMETERS) * (2 + PALPATE_PARAMETERS)]; /* surface, chart, bias; with a bias only */
} palpate_start_fit;

typedef struct {
    int line, known, i, best;
    double lowest, highest, least;
    struct {
        int line;
    } search;
    palpate_minimum minimum;
    palpate_start_fit found;
} palpate_fit;

typedef struct {
    int line, i;
    double elapsed;
} palpate_gathering;
#else
typedef struct palpate_start_fit palpate_start_fit;
#endif

typedef struct {
    int line, above, below, over, in_contact, doubtful, rising;
    double threshold, surface;
    palpate_rise rise;
} palpate_touch;

typedef struct palpate_filter {
    palpate_settings settings;
    /* Called with every estimate where it is not 0: where a touch is found, several become ready at once. */
    void (*listener)(void *context, const palpate_estimate *estimate);
    void *context;
    palpate_estimate latest;
    int phase, failure, made, fed;
    int64_t origin, previous;
    double tare, tare_noise;
    /* Samples in a ring, the oldest at `oldest`: those before the first touch, and those whose turn has not come. */
    palpate_reading record[PALPATE_RECORD];
    int oldest, count, released, seen, shown, begins, lag, after, baseline;
    int share, line, contact; /* what is left of a sample's share; where the next goes on; with what */
    palpate_search search;
    palpate_taring taring;
    palpate_settling settling;
    palpate_touch touch;
    struct {
        int line;
    } delivery;
    /* The filter. */
    double state[PALPATE_STATE], carried_surface;
    int started, active, diverged;
#if PALPATE_WINDOW > 0
    palpate_reading window[PALPATE_WINDOW];
    double contact_force[PALPATE_WINDOW], fit_position[PALPATE_WINDOW], fit_velocity[PALPATE_WINDOW], gaps;
    palpate_fit fit;
    palpate_gathering gathering;
    int held, attempts;
#endif
#if PALPATE_AIR > 0
    double air_force[PALPATE_AIR], air_velocity[PALPATE_AIR];
    double still_mean[2], still_square[2], still_low, still_high;
    int air_count, air_newest, still_count[3], noise_known;
#endif
} palpate_filter;

/* The settings of the pipeline. */
void palpate_defaults(palpate_settings *settings);

/* Restart, with the tare; 0, or PALPATE_NO_ROOM. The listener stays as it is set afterwards. */
int palpate_start(palpate_filter *filter, const palpate_settings *settings);

/* Take in a sample. The number of estimates that became ready, the last of them in `latest`; or what went wrong.
 *
 * The time that it takes is bounded by settings.share: tare, touch and start are searches, which the samples after share
 * among them, so that the first estimates become ready some 0.1 s later, the same to the bit, and then each with its
 * sample. The caller owes it samples in the order of their stamps, at no more than PALPATE_RATE on average;
 * one caller at a time for each filter; and a listener that returns soon. */
int palpate_feed(palpate_filter *filter, const palpate_sample *sample, palpate_estimate *latest);

#ifdef __cplusplus
}
#endif

#endif
