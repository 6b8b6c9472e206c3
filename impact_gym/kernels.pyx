# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False, cdivision=True, cpow=True
"""The compiled program: one module, so that the compiler can inline functions from all included files.

Functions that Python calls do not check shapes and data types of arrays.
"""

from cpython.buffer cimport PyBUF_SIMPLE, PyBuffer_Release, PyObject_GetBuffer
from cpython.pycapsule cimport PyCapsule_GetPointer
from libc.math cimport (
    INFINITY, M_PI, NAN, acos, acosh, atan2, atanh, cbrt, ceil, copysign, cos, exp, expf, expm1, fabs, floor, fmod,
    hypot, isfinite, isinf, isnan, log, log1p, logf, pow, rint, sin, sqrt,
)
from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t, uintptr_t
from libc.string cimport memcpy, memset

import numpy as np

from impact_gym.outcome import ContactRecord, Outcome

cdef extern from "math.h" nogil:
    float exp2f(float x)

cdef extern from *:
    """
    static inline void load_ahead(const void *record, size_t size) {  /* into cache; an invalid address does no harm */
        for (size_t offset = 0; offset < size; offset += 64) __builtin_prefetch((const char *)record + offset);
    }
    """
    void load_ahead(const void *record, size_t size) noexcept nogil
    const char *DIGEST "COMPILED_FROM"

COMPILED_FROM = DIGEST.decode()  # digest of the sources of this program, see `impact_gym.support.sources`

include "physics/contact.pxi"
include "physics/damping.pxi"
include "physics/oscillator.pxi"
include "physics/mechanism.pxi"
include "physics/robot.pxi"
include "task/numbers.pxi"
include "solver/state.pxi"
include "solver/pack.pxi"
include "solver/piece.pxi"
include "solver/flight.pxi"
include "solver/general.pxi"
include "solver/chain.pxi"
include "solver/bounds.pxi"
include "solver/dop853.pxi"
include "solver/series.pxi"
include "solver/rosenbrock.pxi"
include "solver/stepper.pxi"
include "solver/recording.pxi"
include "solver/events.pxi"
include "solver/search.pxi"
include "solver/integrate.pxi"
include "solver/advance.pxi"
include "task/action.pxi"
include "task/reward.pxi"
include "task/records.pxi"
include "task/draw.pxi"
include "task/alarm.pxi"
include "task/settle.pxi"
include "task/observation.pxi"
include "task/episode.pxi"
include "task/range_sensor.pxi"
include "teleop/channel.pxi"
include "teleop/operator.pxi"
include "teleop/link.pxi"

GRAVITY = STANDARD_GRAVITY

cdef ActionEntry blank_action
cdef RunPlan blank_plan
cdef Chain blank_chain
cdef ContactRow blank_contact
cdef TraceRow blank_trace
cdef Episode blank_episode
cdef Draw blank_draw
cdef Entry blank_entry
cdef ChainModel blank_model
cdef Link blank_link
cdef Packet blank_packet
cdef RangeReading blank_range_reading
cdef Reading blank_reading
cdef Task blank_task


def layout(blank):
    """Return the NumPy data type of a C structure of eight-byte numbers; `blank` is the structure as a dict."""
    kinds = {dict: layout, float: lambda _: np.float64, int: lambda _: np.int64}
    kinds[list] = lambda values: np.dtype((kinds[type(values[0])](values[0]), len(values)))
    return np.dtype([(name, kinds[type(value)](value)) for name, value in blank.items()])


RUN_PLAN, CHAIN, CONTACT, TRACE = map(layout, (blank_plan, blank_chain, blank_contact, blank_trace))
MOUNT = RUN_PLAN["mount"]
ACTION = layout(blank_action)
DRAW, EPISODE, ENTRY, CHAIN_MODEL = map(layout, (blank_draw, blank_episode, blank_entry, blank_model))
RECORD, SENSORS = EPISODE["drawn"], EPISODE["sensors"]
READING, TASK, LINK, PACKET = map(layout, (blank_reading, blank_task, blank_link, blank_packet))
RANGE_READING = layout(blank_range_reading)
assert (RUN_PLAN.itemsize, CHAIN.itemsize, EPISODE.itemsize) == (sizeof(RunPlan), sizeof(Chain), sizeof(Episode))


cdef void *memory_of(object array) except? NULL:
    """Return the address of the memory of an array; ValueError: it is not contiguous."""
    cdef Py_buffer buffer
    PyObject_GetBuffer(array, &buffer, PyBUF_SIMPLE)
    cdef void *address = buffer.buf
    PyBuffer_Release(&buffer)
    return address


cdef Recorder recorder_of(tuple arrays):
    """Return a recorder that writes to `arrays`, see `approach_rows`; None: one that records nothing."""
    if arrays is None:
        return Recorder(NULL, NULL, NULL, 0, 0, 0, 1.0)
    contacts, trace, snaps, interval = arrays
    return Recorder(
        <ContactRow *> memory_of(contacts), <TraceRow *> memory_of(trace), <double *> memory_of(snaps),
        len(contacts), trace.shape[trace.ndim - 1], len(snaps), interval,
    )


cdef void run_plans(
    Run *run, const RunPlan *plans, Chain *chains, int64_t first, int64_t last, double tolerance, int64_t max_steps
) noexcept nogil:
    """Run the approaches `first` to `last` - 1 of `plans`, see `approach_rows`."""
    cdef Work work
    cdef ChainModel model
    cdef const RunPlan *plan
    cdef const Contact *given
    cdef int64_t i
    run.work, run.model, run.tell_touch, run.tolerance, run.max_steps = &work, &model, False, tolerance, max_steps
    for i in range(first, last):
        plan, given = &plans[i], &plans[i].contact
        pack_model(&plan.mount, &model)
        run.contact = contact_of(given.stiffness, given.nominal, given.m, given.n, given.reference)
        run.object_mass, run.threshold, run.reaction = plan.object_mass, plan.threshold, plan.delay
        run.ground = STANDARD_GRAVITY * plan.friction
        run_approach(run, &chains[i], plan)


def approach_rows(
    plans, tables, chains, int64_t first, int64_t last, double tolerance, int64_t max_steps, tuple recorder
):
    """Run the approaches `first` to `last` - 1 of `plans` (n, RUN_PLAN), and write the results to `chains` (n, CHAIN).

    Args:
        tables: array (k,) of all robot tables and motions; a plan's `mount.table` and `motion` are indices in it.
        tolerance: allowed local error of a step, in natural units (see `contact.pxi`); relative for components above 1.
        max_steps: an approach that needs more integration steps ends with the status STEP_LIMIT.
        recorder: arrays of the last approach: contacts (CONTACT), trace points (TRACE), times (s) at which a slider
            passes its alignment; and largest time (s) between trace points of a flight. Empty arrays, and None for
            all, record nothing.
    """
    cdef Run run
    cdef const RunPlan *plan = <const RunPlan *> memory_of(plans)
    cdef Chain *chain = <Chain *> memory_of(chains)
    run.tables, run.recorder = <const double *> memory_of(tables), recorder_of(recorder)
    with nogil:
        run_plans(&run, plan, chain, first, last, tolerance, max_steps)


def run_one(plan, tables, double tolerance, int64_t max_steps, tuple recorder):
    """Run one approach; `plan` is a RUN_PLAN, see `approach_rows`. Without an array for them, up to 64 contacts are logged.

    Returns:
        Status; time (s) of the end; numbers of contacts, of trace points and of passages of the alignment, also of those
        that did not fit into their arrays; and the `Outcome` of a run that succeeded, still without `trace` and
        `snap_through`.
    """
    cdef Run run
    cdef Chain chain
    cdef ContactRow[64] rows
    cdef ContactRow *row
    cdef const RunPlan *given = <const RunPlan *> memory_of(plan)
    run.tables, run.recorder = <const double *> memory_of(tables), recorder_of(recorder)
    if run.recorder.contact_rows == 0:
        run.recorder.contacts, run.recorder.contact_rows = rows, 64
    with nogil:
        run_plans(&run, given, &chain, 0, 1, tolerance, max_steps)
    new, contacts = tuple.__new__, []  # as `_make` of a NamedTuple, without its cost
    for i in range(min(chain.logged, run.recorder.contact_rows)):
        row = &run.recorder.contacts[i]
        contacts.append(new(ContactRecord, (
            row.start, None if isnan(row.end) else row.end, row.approach_velocity, row.separation_velocity,
            row.peak_force, row.impulse, row.object_velocity, row.coupling_impulse, row.momentum_error,
        )))
    outcome = new(Outcome, (
        chain.final_object_velocity, chain.final_tool_velocity, chain.final_flange_velocity, chain.peak_force,
        None if isinf(chain.detection) else chain.detection, tuple(contacts), chain.coupling_impulse,
        chain.momentum_error, chain.steps, "ok", None, (), chain.peak_object_velocity,
        None if run.ground == 0.0 else chain.slide, None if run.ground == 0.0 else chain.rest_time,
    ))
    return chain.status, chain.time, (chain.logged, chain.traced, chain.snaps), outcome


def models_of(mounts):
    """Return the simplest equivalent models (n, CHAIN_MODEL) of `mounts` (n, MOUNT): tool mass, coupling and robot."""
    cdef int64_t i
    models = np.empty(len(mounts), CHAIN_MODEL)
    cdef const Mount *mount = <const Mount *> memory_of(mounts)
    cdef ChainModel *model = <ChainModel *> memory_of(models)
    for i in range(len(mounts)):
        pack_model(&mount[i], &model[i])
    return models


def draw_uniforms(list generators, rows, uniforms):
    """For each of `rows` (k, int64), draw uniform numbers from the row's generator into `uniforms` (k, UNIFORMS)."""
    cdef const int64_t *row = <const int64_t *> memory_of(rows)
    cdef double *number = <double *> memory_of(uniforms)
    cdef Generator *generator
    cdef int64_t k, i
    for k in range(len(rows)):
        capsule = (<object> generators[row[k]]).bit_generator.capsule
        generator = <Generator *> PyCapsule_GetPointer(capsule, "BitGenerator")
        for i in range(UNIFORMS):
            number[0] = generator.next_double(generator.state)
            number += 1


cdef class Rows:
    """A batch of environments, each a row in arrays that Python owns, and the functions that step these rows."""

    cdef object arrays
    cdef const Task *tasks
    cdef const Draw *draws
    cdef ChainModel *models
    cdef const double *tables
    cdef Chain *chains
    cdef Episode *episodes
    cdef Reading *readings
    cdef RangeReading *ranges
    cdef Link *links
    cdef Packet *packets
    cdef float *observations
    cdef double *rewards
    cdef const Entry *entries
    cdef int64_t slots, range_slots, each_range, packet_slots, each_link, action_size, length
    cdef int64_t each_task, each_model, max_steps
    cdef Recorder recorder

    def __init__(
        self, tasks, draws, models, tables, chains, episodes, readings, ranges, links, packets, observations, rewards,
        entries, tuple recorder, max_steps, action_size,
    ):
        """Keep the addresses of the arrays of `size` environments.

        Args:
            tasks: (size,) or (1,), TASK.
            draws: the draws of all tasks one after another (n,), DRAW.
            models: (size,), CHAIN_MODEL; (1,) if there is one task whose tool mass, coupling and robot are fixed.
            tables: see `approach_rows`.
            chains, episodes, rewards: (size,), CHAIN, EPISODE and float64.
            readings: (size, n), READING.
            ranges: (size, k), RANGE_READING; no rows without a range sensor.
            links, packets: (size,) LINK and (size, p) PACKET; no rows without an operator.
            observations: (size, length), float32.
            entries: (length,), ENTRY, one for each number of an observation.
            recorder: see `approach_rows`; its trace is (size, points).
        """
        self.arrays = (
            tasks, draws, models, tables, chains, episodes, readings, ranges, links, packets, observations, rewards,
            entries, recorder,
        )
        self.links, self.each_link, self.action_size = <Link *> memory_of(links), len(links) > 0, action_size
        self.packets, self.packet_slots = <Packet *> memory_of(packets), packets.shape[1]
        self.tasks, self.each_task = <const Task *> memory_of(tasks), len(tasks) > 1
        self.draws = <const Draw *> memory_of(draws)
        self.models, self.each_model = <ChainModel *> memory_of(models), len(models) > 1
        self.tables = <const double *> memory_of(tables)
        self.chains, self.episodes = <Chain *> memory_of(chains), <Episode *> memory_of(episodes)
        self.readings, self.slots = <Reading *> memory_of(readings), readings.shape[1]
        self.ranges, self.range_slots = <RangeReading *> memory_of(ranges), ranges.shape[1]
        self.each_range = self.range_slots if len(ranges) else 0
        self.observations, self.length = <float *> memory_of(observations), observations.shape[1]
        self.rewards, self.entries = <double *> memory_of(rewards), <const Entry *> memory_of(entries)
        self.recorder, self.max_steps = recorder_of(recorder), max_steps

    cdef inline Row row(self, int64_t i) noexcept nogil:
        """Return the addresses of the records of environment `i`."""
        return Row(
            &self.tasks[i * self.each_task], &self.chains[i], &self.episodes[i], &self.readings[i * self.slots],
            self.slots, self.entries, self.length, &self.observations[i * self.length],
            &self.links[i * self.each_link], &self.packets[i * self.packet_slots], self.packet_slots, self.tables,
            &self.ranges[i * self.each_range], self.range_slots,
        )

    def begin(self, rows, uniforms, fixed):
        """Begin episodes in `rows` (k,); `draw_record` explains `uniforms` (k, UNIFORMS) and `fixed` (k,) or None."""
        cdef const int64_t *index = <const int64_t *> memory_of(rows)
        cdef const double *uniform = <const double *> memory_of(uniforms)
        cdef const Record *given = NULL if fixed is None else <const Record *> memory_of(fixed)
        cdef Record free
        cdef Row row
        cdef Record drawn
        cdef Mount mount
        cdef int64_t k, count = len(rows)
        memset(&free, 0xFF, sizeof(Record))  # all numbers nan: nothing is fixed
        with nogil:
            for k in range(count):
                row = self.row(index[k])
                drawn = draw_record(row.task, self.draws, &uniform[k * UNIFORMS], &given[k] if given else &free)
                if row.task.mount_drawn:
                    mount = row.task.mount
                    mount.tool_mass, mount.coupling, mount.robot = drawn.tool_mass, drawn.coupling, drawn.robot
                    pack_model(&mount, &self.models[index[k] * self.each_model])
                begin_episode(&row, &self.models[index[k] * self.each_model], drawn)

    def step(self, actions, skip, int64_t first, int64_t last):
        """Play a control step with `actions` (size, n) in rows `first` to `last` - 1 whose `skip` (size,) is 0."""
        cdef const double *action = <const double *> memory_of(actions)
        cdef const uint8_t *skipped = <const uint8_t *> memory_of(skip)
        cdef Run run
        cdef Work work
        cdef Row row
        cdef int64_t i
        run.tables, run.recorder, run.work, run.max_steps = self.tables, self.recorder, &work, self.max_steps
        run.reaction = 0.0
        with nogil:
            for i in range(first, last):
                if skipped[i]:
                    continue
                load_ahead(&self.chains[i + 1], sizeof(Chain))
                load_ahead(&self.episodes[i + 1], sizeof(Episode))
                load_ahead(&self.readings[(i + 1) * self.slots], self.slots * sizeof(Reading))
                row = self.row(i)
                run.model = &self.models[i * self.each_model]
                run.recorder.trace = self.recorder.trace + i * self.recorder.trace_rows
                self.rewards[i] = play_step(&run, &row, &action[self.action_size * i])
