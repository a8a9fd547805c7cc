/*
 * What a loop may meet, with what nadrc_ros @{version} makes of it: @{ticks} calls, in this order.
 * Define @{NAME}_TEST_CALLS as fewer where the memory is too small for all.
 */
#ifndef @{NAME}_TEST_VECTORS_H
#define @{NAME}_TEST_VECTORS_H

#include "@{name}.h"

#include <math.h>

#ifndef @{NAME}_TEST_CALLS
#define @{NAME}_TEST_CALLS @{ticks}
#endif

enum { CALL_INIT, CALL_STEP, CALL_NO_SAMPLE, CALL_ENABLE, CALL_DISABLE };

/* Of a call: what is given, what is returned, which call, whether with a reference, and then. */
typedef struct {
    @{real} y;
    @{real} reference[@{NAME}_REFERENCES];
    @{real} applied;@{dt_member}
    @{real} command;
    unsigned char call;
    unsigned char referenced;
    unsigned char status;
    unsigned char mode;
    unsigned char cause;
} test_vector;

static const test_vector TEST_VECTORS[] = {
@{rows}
};

#endif
