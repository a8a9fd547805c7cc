/*
 * @{title}
 *
@{about}
 *
 * Written by `nadrc export c`; do not edit. Compile with -ffp-contract=off, see README.md.
 * One object for each controller, no memory but that, and nothing is shared between them.
 */
#ifndef @{NAME}_H
#define @{NAME}_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

/* How many numbers a reference has: r@{derivatives}. */
#define @{NAME}_REFERENCES @{references}
@{period_macro}
/* What @{name}_init and @{name}_self_test return. */
#define @{NAME}_READY 0
/* The compiler makes one operation of a * b + c: add -ffp-contract=off. */
#define @{NAME}_CONTRACTED 1
/* Numbers below the smallest normal one become 0: do not link with -ffast-math. */
#define @{NAME}_FLUSHED 2

/* What became of the last sample; from NO_MEASUREMENT on the observers were left untouched. */
typedef enum {
@{statuses}
} @{name}_status_t;

/* What the command is: the law's, held, on its way to safe_command, safe_command. */
typedef enum {
@{modes}
} @{name}_mode_t;

/* Why the law does not act, ranked. */
typedef enum {
@{causes}
} @{name}_cause_t;

/* State of the observers and of the limiter. */
typedef struct {
@{law_members}
} @{name}_law;

/* Whether the loop idles at a limit of the command. */
typedef struct {
@{stall_members}
} @{name}_stall;

/* State of the fault policy: ages in s, INFINITY where there was none. */
typedef struct {
@{policy_members}
} @{name}_policy;

/* One controller. Its members are its own business; read it by the functions below. */
typedef struct {
    @{name}_law laws[2];
    @{name}_policy policy;
    @{real} reference[@{size}];
    @{real} ages[@{size}];
    @{real} command;
    @{real} applied;
    @{real} applied_age;
    @{real} waited;
    int current;
    int status;
    int error;
    bool enabled;
} @{name}_state;

/*
 * Begin, or begin anew. u [command unit] is the command that acts now: from it the rate limit counts.
 * y [output unit] is a measurement, which counts as the first of good_samples = @{good_samples}, or NAN.
 * Returns @{NAME}_READY; otherwise the build is not to be used, and the command stays the safe one.
 */
int @{name}_init(@{name}_state *self, @{real} y, @{real} u);

/*
 * Take a sample and return the command to send. Call it once @{per_call}.
 *   y          measurement [output unit]; one that is NAN, infinite or out of range is a bad sample
 *   reference  @{NAME}_REFERENCES numbers, NAN where a derivative is unknown; NULL when no new one came
 *   applied    the command that acted since the last call, if another one did; otherwise NAN@{dt_text}
 */
@{real} @{name}_step(@{name}_state *self, @{real} y, const @{real} *reference, @{real} applied@{dt_parameter});

/* Let a period pass without a sample: call this in place of @{name}_step when none came. */
@{real} @{name}_no_sample(@{name}_state *self@{dt_parameter});

/* Let the law act, as from the start on, or not: then the command goes to safe_command. */
void @{name}_enable(@{name}_state *self, bool enabled);

@{name}_status_t @{name}_status(const @{name}_state *self);
@{name}_mode_t @{name}_mode(const @{name}_state *self);
@{name}_cause_t @{name}_cause(const @{name}_state *self);

/* The output as the level that feeds the law estimates it [output unit]. */
@{real} @{name}_output_estimate(const @{name}_state *self);
/* The estimate of the total disturbance [y^(n)]. */
@{real} @{name}_disturbance_estimate(const @{name}_state *self);

/* Whether this build computes as it must; @{name}_init asks it, too. */
int @{name}_self_test(void);

#ifdef __cplusplus
}
#endif

#endif
