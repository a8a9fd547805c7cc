/*
 * Runs @{name}.c on the calls of test_vectors.h and compares with what Python gave, to the bit.
 * Exit code 0 if all are equal; otherwise the first difference is printed.
 */
#include "test_vectors.h"

#include <stddef.h>
#include <stdio.h>
#include <string.h>

static int same(@{real} left, @{real} right)
{
    return memcmp(&left, &right, sizeof left) == 0;
}

int main(void)
{
    @{name}_state controller;
    @{real} command = @{zero};
    const size_t count = sizeof TEST_VECTORS / sizeof TEST_VECTORS[0];
    size_t i;
    const int wrong = @{name}_self_test();
    if (wrong == @{NAME}_CONTRACTED)
    {
        (void)puts("@{name}: the compiler makes one operation of a * b + c: add -ffp-contract=off");
        return 2;
    }
    if (wrong != @{NAME}_READY)
    {
        (void)puts("@{name}: the smallest numbers become 0: do not link with -ffast-math or -Ofast");
        return 2;
    }
    (void)@{name}_init(&controller, @{nan}, @{zero});
    for (i = 0; i < count; i++)
    {
        const test_vector *const call = &TEST_VECTORS[i];
        const @{real} *const reference = (call->referenced != 0) ? call->reference : NULL;
        switch (call->call)
        {
            case CALL_INIT:
                (void)@{name}_init(&controller, call->y, call->applied);
                command = controller.command;
                break;
            case CALL_STEP:
                command = @{name}_step(&controller, call->y, reference, call->applied@{dt_given});
                break;
            case CALL_NO_SAMPLE:
                command = @{name}_no_sample(&controller@{dt_given});
                break;
            default:
                @{name}_enable(&controller, call->call == CALL_ENABLE);
                break;
        }
        if ((same(command, call->command) == 0) || (controller.status != (int)call->status)
            || ((int)@{name}_mode(&controller) != (int)call->mode)
            || ((int)@{name}_cause(&controller) != (int)call->cause))
        {
            (void)printf("@{name}: call %lu of %lu differs: command %a status %d mode %d cause %d, and Python has "
                         "command %a status %d mode %d cause %d\n",
                         (unsigned long)i, (unsigned long)count, (double)command, controller.status,
                         (int)@{name}_mode(&controller), (int)@{name}_cause(&controller), (double)call->command,
                         (int)call->status, (int)call->mode, (int)call->cause);
            return 1;
        }
    }
    (void)printf("@{name}: all %lu calls give the bits of Python; a controller takes %lu bytes\n",
                 (unsigned long)count, (unsigned long)sizeof controller);
    return 0;
}
