/*
 * @{title}
 * Written by `nadrc export c`; do not edit. The comments name the lines of nadrc_ros that this is.
 */
#include "@{name}.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "@{name}: NaN is a bad sample here, and -ffast-math and -Ofast take it for a good one: build without"
#endif
#if defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__)
#error "@{name}: build without -funsafe-math-optimizations and what it is made of"
#endif
#if @{wide_evaluation}
#error "@{name}: intermediate results are wider than @{real}; on x86 build with -mfpmath=sse -msse2"
#endif
#if @{DIGITS}_MANT_DIG != @{digits}
#error "@{name}: @{real} must be IEEE 754 binary@{bits}"
#endif

#define PERIOD @{period}
#define ORDER @{order}
#define HIGHEST @{highest}

@{tables}

@{functions}

/* nadrc_ros.adrc.intake: what is no number or out of its range is no reference. */
static bool take_reference(@{name}_state *self, const @{real} *reference)
{
    bool taken = false;
    if (reference != NULL)
    {
        const @{real} r = reference[0];
        taken = (r >= -HIGHEST) && (r <= HIGHEST) && (r >= @{reference_min}) && (r <= @{reference_max});
    }
    if (taken)
    {
        self->reference[0] = reference[0];
@{take_derivatives}
    }
    return taken;
}

/* nadrc_ros.adrc.controller.Controller.tick */
static @{real} advance(
    @{name}_state *self, @{real} y, @{real} span, @{real} elapsed, const @{real} *reference, @{real} applied)
{
    const @{real} sent = self->command;
    @{real} acting = sent;
    @{real} downstream = @{nan};
    bool foreign = false;
    @{name}_policy after;
    bool dropped = false;
    int i;
    if (self->error != @{NAME}_READY)
    {
        return @{safe_command};
    }
    if ((applied >= -HIGHEST) && (applied <= HIGHEST))
    {
        self->applied = applied;
        self->applied_age = @{zero};
    }
    else
    {
        self->applied_age += elapsed;
    }
    if (self->applied_age <= @{zero})
    {
        /* nadrc_ros.adrc.command_intake.CommandIntake.compare */
        acting = self->applied;
        downstream = (acting < sent) ? (acting + @{zero}) : ((acting > sent) ? (acting - @{zero}) : sent);
        foreign = !(fabs@{F}(sent - acting) <= (@{same} * fabs@{F}(sent)));
    }
    for (i = 1; i <= ORDER; i++)
    {
        self->ages[i] += elapsed;
    }
    const bool referenced = take_reference(self, reference);
    @{name}_law *const law = &self->laws[1 - self->current];
    self->command = @{tick_call};
    self->policy = after;
    self->current = 1 - self->current;
    for (i = 1; i <= ORDER; i++)
    {
        if (self->ages[i] > @{max_dt})
        {
            dropped = dropped || (self->reference[i] != @{zero});
            self->reference[i] = @{zero};
        }
    }
    if (dropped)
    {
        @{adopt_call};
    }
    return self->command;
}

int @{name}_self_test(void)
{
    /* volatile: the compiler must not do the sum itself */
    volatile @{real} above = @{one} + @{small};
    volatile @{real} below = @{one} - @{small};
    volatile @{real} minus = -@{one};
    volatile @{real} least = @{least};
    const @{real} a = above;
    const @{real} b = below;
    const @{real} c = minus;
    const @{real} sum = (a * b) + c;
    const @{real} half = least * @{half};
    int result = @{NAME}_READY;
    if (sum != @{zero})
    {
        result = @{NAME}_CONTRACTED;
    }
    else if (half == @{zero})
    {
        result = @{NAME}_FLUSHED;
    }
    else
    {
        /* it computes as it must */
    }
    return result;
}

int @{name}_init(@{name}_state *self, @{real} y, @{real} u)
{
    static const @{name}_state BLANK = {
@{blank}
    };
    *self = BLANK;
    self->command = clamp(u);
    if ((y >= @{measurement_min}) && (y <= @{measurement_max}))
    {
        self->policy.good = 1;
        self->policy.last = y;
    }
    self->error = @{name}_self_test();
    return self->error;
}

@{real} @{name}_step(@{name}_state *self, @{real} y, const @{real} *reference, @{real} applied@{dt_parameter})
{
    const @{real} elapsed = @{elapsed};
    const @{real} span = self->waited + elapsed;
    self->waited = @{zero};
    return advance(self, y, span, elapsed, reference, applied);
}

@{real} @{name}_no_sample(@{name}_state *self@{dt_parameter})
{
    const @{real} elapsed = @{elapsed};
    self->waited += elapsed;
    return advance(self, @{nan}, @{zero}, elapsed, NULL, @{nan});
}

void @{name}_enable(@{name}_state *self, bool enabled)
{
    if (!enabled)
    {
        self->policy.stall.at_limit = @{zero};
        self->policy.stall.stalled = @{zero};
    }
    self->enabled = enabled;
}

@{name}_status_t @{name}_status(const @{name}_state *self)
{
    return (@{name}_status_t)self->status;
}

@{name}_mode_t @{name}_mode(const @{name}_state *self)
{
    return (@{name}_mode_t)self->policy.mode;
}

@{name}_cause_t @{name}_cause(const @{name}_state *self)
{
    return (@{name}_cause_t)self->policy.cause;
}

@{real} @{name}_output_estimate(const @{name}_state *self)
{
    return output_estimate(&self->laws[self->current]);
}

@{real} @{name}_disturbance_estimate(const @{name}_state *self)
{
    return disturbance_estimate(&self->laws[self->current]);
}
