/* Co-simulation unit (FMI 2.0): a mass that a spring and a damper pull along, partner of a ballast unit in the tests.
 *
 * The upper end of the spring moves at constant velocity; `force` acts on the mass. Implicit midpoint rule, one step for each
 * communication step. `spring_mass.py` compiles it with MASS (kg), STIFFNESS (N/m), DAMPING (N s/m), SPEED (m/s) and HEIGHT (m)
 * of the mass at the start, and writes its description.
 */

#include <stdlib.h>
#include <string.h>

typedef struct {
    double force, displacement, velocity, end_displacement;
} SpringMass;

typedef SpringMass *Component;
typedef unsigned Reference;
typedef enum { OK, WARNING, DISCARD, ERROR } Status;

/* Value references. */
enum { FORCE, POSITION, VELOCITY };

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

Component fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
                          int visible, int logging)
{
    return calloc(1, sizeof(SpringMass));
}

void fmi2FreeInstance(Component c) { free(c); }

Status fmi2Reset(Component c)
{
    memset(c, 0, sizeof *c);
    return OK;
}

Status fmi2GetReal(Component c, const Reference *references, size_t count, double *values)
{
    for (size_t k = 0; k < count; k++) {
        switch (references[k]) {
        case FORCE: values[k] = c->force; break;
        case POSITION: values[k] = HEIGHT + c->displacement; break;
        case VELOCITY: values[k] = c->velocity; break;
        default: return ERROR;
        }
    }
    return OK;
}

Status fmi2SetReal(Component c, const Reference *references, size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++) {
        if (references[k] != FORCE)
            return ERROR;
        c->force = values[k];
    }
    return OK;
}

Status fmi2DoStep(Component c, double time, double h, int is_final)
{
    c->end_displacement += h * SPEED;
    /* Elongation of the spring at the middle of the step without acceleration. */
    double elongation = c->end_displacement - c->displacement - 0.5 * h * (c->velocity + SPEED);
    double force = c->force + STIFFNESS * elongation + DAMPING * (SPEED - c->velocity);
    double acceleration = force / (MASS + 0.5 * h * DAMPING + 0.25 * h * h * STIFFNESS);
    c->displacement += h * (c->velocity + 0.5 * h * acceleration);
    c->velocity += h * acceleration;
    return OK;
}

Status fmi2GetFMUstate(Component c, void **state)
{
    if (!*state)
        *state = malloc(sizeof *c);
    if (!*state)
        return ERROR;
    memcpy(*state, c, sizeof *c);
    return OK;
}

Status fmi2SetFMUstate(Component c, void *state)
{
    memcpy(c, state, sizeof *c);
    return OK;
}

Status fmi2FreeFMUstate(Component c, void **state)
{
    free(*state);
    *state = NULL;
    return OK;
}

/* Calls that need nothing here, and others that the unit does not offer. */
#define RETURN(status, name, ...) \
    Status fmi2##name(Component c, __VA_ARGS__) { return status; }
typedef const void *Pointer;
RETURN(OK, SetDebugLogging, int on, size_t count, Pointer categories)
RETURN(OK, SetupExperiment, int has_tolerance, double tolerance, double start, int has_stop, double stop)
Status fmi2EnterInitializationMode(Component c) { return OK; }
Status fmi2ExitInitializationMode(Component c) { return OK; }
Status fmi2Terminate(Component c) { return OK; }
Status fmi2CancelStep(Component c) { return ERROR; }
RETURN(ERROR, GetInteger, Pointer references, size_t count, int *values)
RETURN(ERROR, GetBoolean, Pointer references, size_t count, int *values)
RETURN(ERROR, GetString, Pointer references, size_t count, Pointer *values)
RETURN(ERROR, SetInteger, Pointer references, size_t count, Pointer values)
RETURN(ERROR, SetBoolean, Pointer references, size_t count, Pointer values)
RETURN(ERROR, SetString, Pointer references, size_t count, Pointer values)
RETURN(ERROR, SerializedFMUstateSize, void *state, size_t *size)
RETURN(ERROR, SerializeFMUstate, void *state, char *bytes, size_t size)
RETURN(ERROR, DeSerializeFMUstate, Pointer bytes, size_t size, void **state)
RETURN(ERROR, GetDirectionalDerivative, Pointer unknowns, size_t n, Pointer knowns, size_t m, Pointer dv, double *result)
RETURN(ERROR, SetRealInputDerivatives, Pointer references, size_t count, Pointer orders, Pointer values)
RETURN(ERROR, GetRealOutputDerivatives, Pointer references, size_t count, Pointer orders, double *values)
RETURN(DISCARD, GetStatus, int kind, Status *value)
RETURN(DISCARD, GetRealStatus, int kind, double *value)
RETURN(DISCARD, GetIntegerStatus, int kind, int *value)
RETURN(DISCARD, GetBooleanStatus, int kind, int *value)
RETURN(DISCARD, GetStringStatus, int kind, Pointer *value)
