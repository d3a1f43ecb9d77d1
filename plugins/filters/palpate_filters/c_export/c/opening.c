/* A first estimate from a short window: variable projection over the height of the surface (Golub and Pereyra 1973). */

enum { SPAN = 5, FEWEST_FIT = 30, GRID = 49, AMID = 10, COLUMNS = FITTED + BIASED, UNKNOWNS = 2 + PALPATE_PARAMETERS };
enum { ROW = 6 }; /* readings looked at are counted: a row of the fit costs so much */
enum { MATRIX = (int)STATES > (int)UNKNOWNS ? (int)STATES : (int)UNKNOWNS };
static const double DEEPEST_FIT = 0.012; /* [m] of surface above the highest position of the window */

/* A result without the digits that only rounding has made: 24 bits. */
static double told(double value)
{
    int exponent;
    const double mantissa = frexp(value, &exponent);
    return ldexp(rint(ldexp(mantissa, 24)), exponent - 24);
}

/* One more row of a least-squares problem into its triangular factor (size x size), by rotations (Givens 1958). */
static void take_row(double *factor, double *row, int size)
{
    for (int i = 0; i < size; i++) {
        if (row[i] == 0.0) {
            continue;
        }
        double *kept = factor + i * size;
        const double length = sqrt(kept[i] * kept[i] + row[i] * row[i]);
        const double c = kept[i] / length, s = row[i] / length;
        for (int j = i; j < size; j++) {
            const double a = kept[j], b = row[j];
            kept[j] = c * a + s * b;
            row[j] = c * b - s * a;
        }
    }
}

/* Inverse of a matrix by elimination with pivots, in place; 0 where it has none. */
static int invert(double *a, int n)
{
    double b[MATRIX * MATRIX];
    for (int i = 0; i < n * n; i++) {
        b[i] = i % (n + 1) == 0 ? 1.0 : 0.0;
    }
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++) {
            best = fabs(a[i * n + k]) > fabs(a[best * n + k]) ? i : best;
        }
        const double pivot = a[best * n + k];
        if (!(fabs(pivot) > 0.0)) {
            return 0;
        }
        for (int j = 0; j < n; j++) {
            const double x = a[best * n + j], y = b[best * n + j];
            a[best * n + j] = a[k * n + j];
            b[best * n + j] = b[k * n + j];
            a[k * n + j] = x / pivot;
            b[k * n + j] = y / pivot;
        }
        for (int i = 0; i < n; i++) {
            const double times = a[i * n + k];
            for (int j = 0; i != k && j < n; j++) {
                a[i * n + j] -= times * a[k * n + j];
                b[i * n + j] -= times * b[k * n + j];
            }
        }
    }
    for (int i = 0; i < n * n; i++) {
        a[i] = b[i];
    }
    return 1;
}

/* Largest over smallest eigenvalue of a symmetric matrix, by Jacobi's rotations. */
static double condition(const double *matrix, int n)
{
    double a[UNKNOWNS * UNKNOWNS], low = HUGE_VAL, high = 0.0;
    for (int i = 0; i < n * n; i++) {
        a[i] = matrix[i];
    }
    for (int sweep = 0; sweep < 30; sweep++) {
        for (int p = 0; p < n; p++) {
            for (int q = p + 1; q < n; q++) {
                if (a[p * n + q] == 0.0) {
                    continue;
                }
                const double ratio = (a[q * n + q] - a[p * n + p]) / (2.0 * a[p * n + q]);
                const double t = (ratio >= 0.0 ? 1.0 : -1.0) / (fabs(ratio) + sqrt(ratio * ratio + 1.0));
                const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
                for (int k = 0; k < n; k++) {
                    const double x = a[k * n + p], y = a[k * n + q];
                    a[k * n + p] = c * x - s * y;
                    a[k * n + q] = s * x + c * y;
                }
                for (int k = 0; k < n; k++) {
                    const double x = a[p * n + k], y = a[q * n + k];
                    a[p * n + k] = c * x - s * y;
                    a[q * n + k] = s * x + c * y;
                }
            }
        }
    }
    for (int i = 0; i < n; i++) {
        const double value = fabs(a[i * n + i]);
        low = value < low ? value : low;
        high = value > high ? value : high;
    }
    return low > 0.0 ? high / low : HUGE_VAL;
}

/* Position and velocity of a reading by local cubics; as they are next to a missing one. */
static void motion_at(const palpate_filter *f, int i, double *position, double *velocity)
{
    static const double weights[SPAN + 1] = {89.0 / 429.0, 84.0 / 429.0, 69.0 / 429.0, 44.0 / 429.0, 9.0 / 429.0, -36.0 / 429.0};
    const palpate_reading *r = &f->window[i];
    *position = weights[0] * r->position;
    *velocity = weights[0] * r->velocity;
    for (int k = 1; k <= SPAN; k++) {
        *position += weights[k] * (r[-k].position + r[k].position);
        *velocity += weights[k] * (r[-k].velocity + r[k].velocity);
    }
    *position = isfinite(*position) ? *position : r->position;
    *velocity = isfinite(*velocity) ? *velocity : r->velocity;
}

/* Contact force u + m z'' of the window's readings, NaN where it is not known, and the motion there; how many are. */
static int contact_forces(palpate_filter *f, int count)
{
    int known = 0;
    for (int i = 0; i < count; i++) {
        f->contact_force[i] = NAN;
        if (i < SPAN || i >= count - SPAN) {
            continue;
        }
        const palpate_reading *r = &f->window[i], *before = r - SPAN, *after = r + SPAN;
        int whole = 1;
        for (const palpate_reading *one = before; one < after; one++) {
            whole = whole && !(one[1].time - one[0].time > PAUSE);
        }
        const double acceleration = (after->velocity - before->velocity) / (after->time - before->time);
        const double force = r->force + TIP_MASS * acceleration;
        if (whole && isfinite(force) && isfinite(r->velocity) && isfinite(r->position)) {
            f->contact_force[i] = force;
            motion_at(f, i, &f->fit_position[i], &f->fit_velocity[i]);
            known++;
        }
    }
    return known;
}

static void columns_at(const palpate_filter *f, int i, double surface, double *column)
{
    const double point[2] = {surface - f->fit_position[i], -f->fit_velocity[i]};
    force_columns(point, f->settings.start.guess, column);
}

/* Least squares of a factor on chosen columns; the residual's square, or HUGE_VAL where a parameter is negative. */
static double solve_on(const double *factor, unsigned chosen, double *solution)
{
    enum { SIZE = COLUMNS + 1 };
    double small[SIZE * SIZE] = {0.0}, row[SIZE];
    int which[SIZE], count = 0;
    for (int j = 0; j < COLUMNS; j++) {
        solution[j] = 0.0;
        if (chosen >> j & 1u) {
            which[count++] = j;
        }
    }
    for (int i = 0; i < SIZE; i++) {
        for (int j = 0; j < count; j++) {
            row[j] = factor[i * SIZE + which[j]];
        }
        row[count] = factor[i * SIZE + COLUMNS];
        take_row(small, row, count + 1);
    }
    for (int i = count - 1; i >= 0; i--) {
        double rest = small[i * (count + 1) + count];
        for (int j = i + 1; j < count; j++) {
            rest -= small[i * (count + 1) + j] * solution[which[j]];
        }
        solution[which[i]] = rest / small[i * (count + 1) + i];
        if (which[i] < FITTED && !(solution[which[i]] >= 0.0)) {
            return HUGE_VAL;
        }
    }
    const double residual = small[count * (count + 1) + count];
    return residual * residual;
}

/* Sum of squares, parameters (none negative) and bias that explain the force best with the surface at a height. */
static double misfit(palpate_filter *f, int count, double surface, double *theta, double *bias)
{
    enum { SIZE = COLUMNS + 1 };
    double factor[SIZE * SIZE] = {0.0}, row[SIZE], scale[SIZE] = {0.0}, solution[SIZE], best = HUGE_VAL, square = 0.0;
    int usable = 1;
    f->share -= ROW * count;
    *bias = 0.0;
    for (int i = SPAN; i < count - SPAN; i++) {
        if (!isfinite(f->contact_force[i])) {
            continue;
        }
        columns_at(f, i, surface, row);
        for (int j = 0; j < FITTED; j++) {
            scale[j] += row[j] * row[j];
        }
        for (int j = FITTED; j < COLUMNS; j++) {
            row[j] = 1.0;
        }
        row[COLUMNS] = f->contact_force[i];
        square += row[COLUMNS] * row[COLUMNS];
        take_row(factor, row, SIZE);
    }
    for (int j = 0; j < FITTED; j++) {
        theta[j] = 0.0;
        usable = usable && isfinite(scale[j]) && scale[j] > 0.0;
    }
    if (!usable) {
        return square;
    }
#if BIASED
    for (int j = 0; j < SIZE; j++) {
        row[j] = j == FITTED ? f->settings.start.force_noise / bias_std(f, f->window[0].time) : 0.0;
    }
    take_row(factor, row, SIZE);
#endif
    /* With all columns where that leaves none negative, else with those that leave least. */
    const unsigned every = (1u << COLUMNS) - 1u, free_ones = every & ~((1u << FITTED) - 1u);
    for (unsigned chosen = (1u << FITTED); chosen-- > 0u;) {
        const double left = solve_on(factor, chosen | free_ones, solution);
        if (left < best) {
            best = left;
            for (int j = 0; j < FITTED; j++) {
                theta[j] = solution[j];
            }
            *bias = BIASED ? solution[FITTED] : 0.0;
            if (chosen == (1u << FITTED) - 1u) {
                break;
            }
        }
    }
    return best;
}

/* The next height of a search for a minimum: golden sections and parabolas (Brent 1973), to 10 nm; 0 at its end. */
static int next_height(palpate_minimum *m)
{
    const double golden = 0.5 * (3.0 - sqrt(5.0)), precision = sqrt(2.2e-16);
    const double middle = 0.5 * (m->a + m->b), near = precision * fabs(m->x) + 1e-8 / 3.0;
    if (m->calls++ >= 499 || fabs(m->x - middle) <= 2.0 * near - 0.5 * (m->b - m->a)) {
        return 0;
    }
    int section = 1;
    if (fabs(m->before) > near) {
        const double r = (m->x - m->second) * (m->fx - m->f_third);
        double q = (m->x - m->third) * (m->fx - m->f_second), p = (m->x - m->third) * q - (m->x - m->second) * r;
        q = 2.0 * (q - r);
        p = q > 0.0 ? -p : p;
        q = fabs(q);
        const double last = m->before;
        m->before = m->step;
        if (fabs(p) < fabs(0.5 * q * last) && p > q * (m->a - m->x) && p < q * (m->b - m->x)) {
            m->step = p / q;
            section = 0;
            if (m->x + m->step - m->a < 2.0 * near || m->b - (m->x + m->step) < 2.0 * near) {
                m->step = middle >= m->x ? near : -near;
            }
        }
    }
    if (section) {
        m->before = m->x >= middle ? m->a - m->x : m->b - m->x;
        m->step = golden * m->before;
    }
    const double length = fabs(m->step) > near ? fabs(m->step) : near;
    m->u = m->step >= 0.0 ? m->x + length : m->x - length;
    return 1;
}

/* Take in the misfit at that height. */
static void take_height(palpate_minimum *m, double fu)
{
    const double u = m->u;
    if (fu <= m->fx) {
        *(u >= m->x ? &m->a : &m->b) = m->x;
        m->third = m->second;
        m->f_third = m->f_second;
        m->second = m->x;
        m->f_second = m->fx;
        m->x = u;
        m->fx = fu;
    } else {
        *(u < m->x ? &m->a : &m->b) = u;
        if (fu <= m->f_second || m->second == m->x) {
            m->third = m->second;
            m->f_third = m->f_second;
            m->second = u;
            m->f_second = fu;
        } else if (fu <= m->f_third || m->third == m->x || m->third == m->second) {
            m->third = u;
            m->f_third = fu;
        }
    }
}

static double height_of_grid(int i, double lowest, double highest)
{
    if (i < AMID) {
        return (i + 1) * ((highest - lowest) / 11.0) + lowest;
    }
    const double part = i - AMID < GRID - 1 ? (i - AMID) * (1.0 / (GRID - 1)) : 1.0;
    return highest + part * part * DEEPEST_FIT;
}

/* The surface height of the smallest misfit: a grid from within the motion upwards, then a bounded search. */
static int best_surface(palpate_filter *f, int count, double *surface)
{
    palpate_fit *fit = &f->fit;
    palpate_minimum *m = &fit->minimum;
    double theta[PALPATE_PARAMETERS], bias;
    RESUME(&fit->search)
    fit->lowest = HUGE_VAL;
    fit->highest = -HUGE_VAL;
    for (int i = SPAN; i < count - SPAN; i++) {
        if (isfinite(f->contact_force[i])) {
            const double position = f->fit_position[i];
            fit->lowest = position < fit->lowest ? position : fit->lowest;
            fit->highest = position > fit->highest ? position : fit->highest;
        }
    }
    f->share -= ROW * count;
    fit->least = HUGE_VAL;
    fit->best = 0;
    for (fit->i = 0; fit->i < AMID + GRID; fit->i++) {
        PAUSE_IF_DONE(f, &fit->search);
        const double cost = misfit(f, count, height_of_grid(fit->i, fit->lowest, fit->highest), theta, &bias);
        if (cost < fit->least) {
            fit->least = cost;
            fit->best = fit->i;
        }
    }
    m->a = height_of_grid(fit->best > 0 ? fit->best - 1 : 0, fit->lowest, fit->highest);
    m->b = height_of_grid(fit->best < AMID + GRID - 1 ? fit->best + 1 : fit->best, fit->lowest, fit->highest);
    m->x = m->second = m->third = m->a + 0.5 * (3.0 - sqrt(5.0)) * (m->b - m->a);
    m->step = m->before = 0.0;
    m->calls = 0;
    m->fx = m->f_second = m->f_third = misfit(f, count, m->x, theta, &bias);
    while (next_height(m)) {
        PAUSE_IF_DONE(f, &fit->search);
        take_height(m, misfit(f, count, m->u, theta, &bias));
    }
    *surface = m->fx <= fit->least ? m->x : height_of_grid(fit->best, fit->lowest, fit->highest);
    END(&fit->search, 1);
}

/* The surface's slope at a reading, then the columns. */
static void design_row(const palpate_filter *f, int i, double surface, const double *theta, double *row)
{
    double above[FITTED], below[FITTED];
    columns_at(f, i, surface + 1e-6, above);
    columns_at(f, i, surface - 1e-6, below);
    columns_at(f, i, surface, row + 1);
    row[0] = 0.0;
    for (int j = 0; j < FITTED; j++) {
        row[0] += (above[j] - below[j]) * theta[j];
    }
    row[0] /= 2e-6;
}

#if BIASED
/* How surface, parameters and bias hang together: 0 where the first parameter is lost in noise. */
static int fit_with_bias(const palpate_filter *f, int count, palpate_start_fit *found, const double *theta, double std)
{
    enum { TOLD = FITTED + 2 };
    double row[FITTED + 1], whole[UNKNOWNS], known[TOLD * TOLD], scale[TOLD];
    int at[TOLD];
    const double noise = f->settings.start.force_noise;
    for (int i = 0; i < UNKNOWNS * UNKNOWNS; i++) {
        found->information[i] = 0.0;
    }
    for (int i = SPAN; i < count - SPAN; i++) {
        if (!isfinite(f->contact_force[i])) {
            continue;
        }
        double sum = 0.0;
        design_row(f, i, found->surface, theta, row);
        for (int j = 0; j < UNKNOWNS; j++) {
            whole[j] = 0.0;
        }
        whole[0] = row[0] / noise;
        for (int j = 0; j < FITTED; j++) { /* the first logarithm multiplies the whole force */
            sum += row[1 + j] * theta[j];
            whole[1 + fitted[j]] = row[1 + j] * theta[j] / noise;
        }
        if (fitted[0] == 0) {
            whole[1] = sum / noise;
        }
        whole[UNKNOWNS - 1] = 1.0 / noise;
        for (int j = 0; j < UNKNOWNS; j++) {
            for (int k = 0; k < UNKNOWNS; k++) {
                found->information[j * UNKNOWNS + k] += whole[j] * whole[k];
            }
        }
    }
    at[0] = 0;
    at[TOLD - 1] = UNKNOWNS - 1;
    for (int j = 0; j < FITTED; j++) {
        at[1 + j] = 1 + fitted[j];
    }
    for (int j = 0; j < TOLD; j++) {
        const double own = found->information[at[j] * (UNKNOWNS + 1)];
        scale[j] = sqrt(j == TOLD - 1 ? own + 1.0 / (std * std) : own);
    }
    for (int j = 0; j < TOLD; j++) {
        for (int k = 0; k < TOLD; k++) {
            const double own = found->information[at[j] * UNKNOWNS + at[k]];
            const double pull = j == TOLD - 1 && k == TOLD - 1 ? 1.0 / (std * std) : 0.0;
            known[j * TOLD + k] = (own + pull) / (scale[j] * scale[k]);
        }
    }
    if (condition(known, TOLD) > 1e14 || !invert(known, TOLD)) {
        return 0;
    }
    for (int j = 0; j < FITTED; j++) {
        const double relative = sqrt(known[(1 + j) * (TOLD + 1)]) / scale[1 + j];
        if (j == 0 && relative > 1.0) {
            return 0;
        }
        found->theta_std[fitted[j]] = theta[j] * relative;
    }
    found->surface_std = sqrt(known[0]) / scale[0];
    return 1;
}
#else
static int fit_without_bias(const palpate_filter *f, int count, palpate_start_fit *found, const double *plain,
                            const double *theta, const double *scale, double variance)
{
    enum { SIZE = FITTED + 1 };
    double information[SIZE * SIZE] = {0.0}, row[SIZE];
    for (int i = SPAN; i < count - SPAN; i++) {
        if (isfinite(f->contact_force[i])) {
            design_row(f, i, found->surface, plain, row);
            for (int j = 0; j < SIZE; j++) {
                for (int k = 0; k < SIZE; k++) {
                    information[j * SIZE + k] += row[j] / scale[j] * (row[k] / scale[k]);
                }
            }
        }
    }
    if (condition(information, SIZE) > 1e14 || !invert(information, SIZE)) {
        return 0;
    }
    found->surface_std = sqrt(information[0] * variance) / scale[0];
    for (int j = 0; j < FITTED; j++) {
        const double std = sqrt(information[(1 + j) * (SIZE + 1)] * variance) / scale[1 + j];
        if (j == 0 && std > theta[0]) { /* the first parameter is lost in noise */
            return 0;
        }
        found->theta_std[fitted[j]] = std;
    }
    return 1;
}
#endif

/* Parameters by least squares on u + m z'' = F(d, d') + b at the surface; 0 where the window does not determine them. */
static int fit_at_surface(palpate_filter *f, int count, int lenient, palpate_start_fit *found)
{
    double theta[FITTED], scale[FITTED + 1] = {0.0}, row[FITTED + 1];
#if !BIASED
    double plain[FITTED];
#endif
    const int known = f->fit.known;
    const double left = misfit(f, count, found->surface, theta, &found->bias);
    const double variance = left / (known - FITTED - 1);
    for (int i = SPAN; i < count - SPAN; i++) {
        if (isfinite(f->contact_force[i])) {
            design_row(f, i, found->surface, theta, row);
            for (int j = 0; j <= FITTED; j++) {
                scale[j] += row[j] * row[j];
            }
        }
    }
    int usable = 1;
    for (int j = 0; j <= FITTED; j++) {
        scale[j] = sqrt(scale[j]);
        usable = usable && isfinite(scale[j]) && scale[j] > 0.0;
    }
    const int mended = !BIASED && lenient && usable && theta[0] > 0.0;
    for (int j = 0; j < PALPATE_PARAMETERS; j++) {
        found->theta[j] = f->settings.start.guess[j];
        found->theta_std[j] = 0.0;
    }
    for (int j = 0; j < FITTED; j++) {
#if !BIASED
        plain[j] = theta[j];
#endif
        if (mended && !(theta[j] > 0.0)) {
            theta[j] = sqrt(variance) / scale[1 + j];
        }
        usable = usable && theta[j] > 0.0;
        found->theta[fitted[j]] = theta[j];
    }
    if (!usable) {
        return 0;
    }
#if BIASED
    return fit_with_bias(f, count, found, theta, bias_std(f, f->window[0].time));
#else
    return fit_without_bias(f, count, found, plain, theta, scale, variance);
#endif
}

/* The same with the surface's height, without the digits that no window determines. */
static int fit_start(palpate_filter *f, int count, int lenient, palpate_start_fit *found)
{
    palpate_fit *fit = &f->fit;
    int answer = 0;
    RESUME(fit)
    fit->known = contact_forces(f, count);
    f->share -= 2 * ROW * count;
    if (fit->known < FEWEST_FIT) {
        LEAVE(fit, 0);
    }
    AWAIT(fit, answer, best_surface(f, count, &found->surface));
    PAUSE_IF_DONE(f, fit);
    f->share -= 8 * ROW * count;
    if (!fit_at_surface(f, count, lenient, found)) {
        LEAVE(fit, 0);
    }
    found->surface = told(found->surface);
    found->surface_std = told(found->surface_std);
    found->bias = told(found->bias);
    for (int i = 0; i < PALPATE_PARAMETERS; i++) {
        found->theta[i] = told(found->theta[i]);
        found->theta_std[i] = told(found->theta_std[i]);
    }
    END(fit, 1);
}
