/* A controller whose commands tell at which reading it was called last, how often, and with which time weight. */
#include <math.h>
typedef struct { double time, alarm; } probe_sensors;
typedef struct { double velocity, acceleration; } probe_command;
typedef struct { double weight, calls; } probe_state;
static int probe_finite(const double *number) { return isfinite(*number); }
static void probe_reset(probe_state *state, double weight) { state->weight = weight; state->calls = 0.0; }
static void probe_step(probe_state *state, const probe_sensors *sensors, probe_command *command)
{
    command->velocity = sensors->time;
    command->acceleration = 100.0 * state->weight + ++state->calls;
}
