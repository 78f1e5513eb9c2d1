/* A reduced model as a Functional Mock-up Unit for model exchange, FMI 2.0. */

#include <stdlib.h>
#include <string.h>

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

@DATA@
enum { OK = 0, ERROR = 3 };
enum { Q = 0, DQ = N, V = 2 * N, DV = 3 * N, LOAD = 4 * N, FORCE = LOAD + K, X = FORCE + M,
       DX = X + M, PROBE = DX + M, SIZE = PROBE + D };

typedef double Real;
typedef int Int;
typedef unsigned int Ref;
typedef struct { Real values[SIZE]; } Model;
typedef struct { Int steps, stop, nominals, values, next; Real time; } EventInfo;

/* q'' = A [monomials of q] - C q' + P s - G F, and the displacements that follow */
static void evaluate(Model *m) {
    Real *x = m->values, terms[TERMS > 0 ? TERMS : 1];
    int i, j, k, t = 0;
    terms[t++] = 1.0;
    for (i = 0; i < N; i++) terms[t++] = x[Q + i];
    if (TERMS > 1 + N) {
        for (i = 0; i < N; i++)
            for (j = i; j < N; j++) terms[t++] = x[Q + i] * x[Q + j];
        for (i = 0; i < N; i++)
            for (j = i; j < N; j++)
                for (k = j; k < N; k++) terms[t++] = x[Q + i] * x[Q + j] * x[Q + k];
    }
    for (i = 0; i < N; i++) {
        Real sum = 0.0;
        for (t = 0; t < TERMS; t++) sum -= A[i * TERMS + t] * terms[t];
        for (j = 0; j < N; j++) sum -= C[i * N + j] * x[V + j];
        for (j = 0; j < K; j++) sum += P[i * K + j] * x[LOAD + j];
        for (j = 0; j < M; j++) sum -= G[i * M + j] * x[FORCE + j];
        x[DQ + i] = x[V + i];
        x[DV + i] = sum;
    }
    for (i = 0; i < M; i++) {
        x[X + i] = OFFSET[i];
        x[DX + i] = 0.0;
        for (j = 0; j < N; j++) {
            x[X + i] += ROWS[i * N + j] * x[Q + j];
            x[DX + i] += ROWS[i * N + j] * x[V + j];
        }
    }
    for (i = 0; i < D; i++) {
        x[PROBE + i] = PROBE_OFFSET[i];
        for (j = 0; j < N; j++) x[PROBE + i] += PROBE_ROWS[i * N + j] * x[Q + j];
    }
}

static void start(Model *m) {
    memset(m->values, 0, sizeof m->values);
    if (K > 0) memcpy(m->values + LOAD, START, K * sizeof(Real));
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT void *fmi2Instantiate(const char *name, Int type, const char *guid, const char *resources,
                             const void *callbacks, Int visible, Int logging) {
    Model *m = NULL;
    (void)name, (void)resources, (void)callbacks, (void)visible, (void)logging;
    if (type == 0 && guid && strcmp(guid, GUID) == 0) m = malloc(sizeof(Model));
    if (m) start(m);
    return m;
}

EXPORT void fmi2FreeInstance(void *c) { free(c); }
EXPORT Int fmi2Reset(void *c) { start(c); return OK; }

EXPORT Int fmi2GetReal(void *c, const Ref refs[], size_t count, Real values[]) {
    size_t i;
    evaluate(c);
    for (i = 0; i < count; i++) {
        if (refs[i] >= SIZE) return ERROR;
        values[i] = ((Model *)c)->values[refs[i]];
    }
    return OK;
}

EXPORT Int fmi2SetReal(void *c, const Ref refs[], size_t count, const Real values[]) {
    size_t i;
    for (i = 0; i < count; i++) {
        Ref r = refs[i];
        if (!(r < DQ || (r >= V && r < DV) || (r >= LOAD && r < X))) return ERROR;
        ((Model *)c)->values[r] = values[i];
    }
    return OK;
}

EXPORT Int fmi2SetContinuousStates(void *c, const Real states[], size_t count) {
    if (count != 2 * N) return ERROR;
    memcpy(((Model *)c)->values + Q, states, N * sizeof(Real));
    memcpy(((Model *)c)->values + V, states + N, N * sizeof(Real));
    return OK;
}

EXPORT Int fmi2GetContinuousStates(void *c, Real states[], size_t count) {
    if (count != 2 * N) return ERROR;
    memcpy(states, ((Model *)c)->values + Q, N * sizeof(Real));
    memcpy(states + N, ((Model *)c)->values + V, N * sizeof(Real));
    return OK;
}

EXPORT Int fmi2GetDerivatives(void *c, Real rates[], size_t count) {
    if (count != 2 * N) return ERROR;
    evaluate(c);
    memcpy(rates, ((Model *)c)->values + DQ, N * sizeof(Real));
    memcpy(rates + N, ((Model *)c)->values + DV, N * sizeof(Real));
    return OK;
}

EXPORT Int fmi2GetNominalsOfContinuousStates(void *c, Real nominals[], size_t count) {
    size_t i;
    (void)c;
    for (i = 0; i < count; i++) nominals[i] = 1.0;
    return OK;
}

EXPORT Int fmi2NewDiscreteStates(void *c, EventInfo *info) {
    (void)c;
    memset(info, 0, sizeof *info);
    return OK;
}

EXPORT Int fmi2CompletedIntegratorStep(void *c, Int keep, Int *event, Int *stop) {
    (void)c, (void)keep;
    *event = *stop = 0;
    return OK;
}

EXPORT Int fmi2GetFMUstate(void *c, void **state) {
    if (!*state) *state = malloc(sizeof(Model));
    if (!*state) return ERROR;
    memcpy(*state, c, sizeof(Model));
    return OK;
}

EXPORT Int fmi2SetFMUstate(void *c, void *state) { memcpy(c, state, sizeof(Model)); return OK; }

EXPORT Int fmi2FreeFMUstate(void *c, void **state) {
    (void)c;
    free(*state);
    *state = NULL;
    return OK;
}

EXPORT Int fmi2SetupExperiment(void *c, Int given, Real tolerance, Real from, Int ends, Real to) {
    (void)c, (void)given, (void)tolerance, (void)from, (void)ends, (void)to;
    return OK;
}

EXPORT Int fmi2SetTime(void *c, Real time) { (void)c, (void)time; return OK; }

EXPORT Int fmi2GetEventIndicators(void *c, Real values[], size_t count) {
    (void)c, (void)values;
    return count ? ERROR : OK;
}

EXPORT Int fmi2SetDebugLogging(void *c, Int on, size_t count, const char *const categories[]) {
    (void)c, (void)on, (void)count, (void)categories;
    return OK;
}

#define STEP(name) EXPORT Int name(void *c) { (void)c; return OK; }
STEP(fmi2EnterInitializationMode)
STEP(fmi2ExitInitializationMode)
STEP(fmi2EnterEventMode)
STEP(fmi2EnterContinuousTimeMode)
STEP(fmi2Terminate)

/* there are only variables of the type Real */
#define NONE(name, type) \
    EXPORT Int name(void *c, const Ref refs[], size_t count, type values[]) { \
        (void)c, (void)refs, (void)values; \
        return count ? ERROR : OK; \
    }
NONE(fmi2GetInteger, Int)
NONE(fmi2SetInteger, const Int)
NONE(fmi2GetBoolean, Int)
NONE(fmi2SetBoolean, const Int)
NONE(fmi2GetString, const char *)
NONE(fmi2SetString, const char *const)

EXPORT Int fmi2SerializedFMUstateSize(void *c, void *state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(Model);
    return OK;
}

EXPORT Int fmi2SerializeFMUstate(void *c, void *state, char bytes[], size_t size) {
    (void)c;
    if (size != sizeof(Model)) return ERROR;
    memcpy(bytes, state, size);
    return OK;
}

EXPORT Int fmi2DeSerializeFMUstate(void *c, const char bytes[], size_t size, void **state) {
    (void)c;
    if (size != sizeof(Model)) return ERROR;
    if (!*state) *state = malloc(size);
    if (!*state) return ERROR;
    memcpy(*state, bytes, size);
    return OK;
}

EXPORT Int fmi2GetDirectionalDerivative(void *c, const Ref out[], size_t outs, const Ref in[],
                                        size_t ins, const Real seed[], Real values[]) {
    (void)c, (void)out, (void)outs, (void)in, (void)ins, (void)seed, (void)values;
    return ERROR;
}
