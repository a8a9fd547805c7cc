/*
 * A loop at 1 kHz on Linux: wait, read, step, write. What has hardware in it is a simulated turntable.
 *
 *   nadrc export c examples/c/yaw.yaml --out examples/c/yaw --name yaw
 *   cd examples/c && cc -O2 -ffp-contract=off -Iyaw linux_loop.c yaw/yaw.c -o linux_loop && ./linux_loop 3
 */
#define _POSIX_C_SOURCE 200809L

#include "yaw.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define NANOSECONDS 1000000000L

static double angle, speed;

static bool read_angle(double *y)
{
    static unsigned long count;
    count++;
    if (count % 100UL == 0UL)
    {
        return false; /* a sample that did not come */
    }
    *y = angle;
    return true;
}

static void write_voltage(double u)
{
    speed += YAW_PERIOD * (45.0 * u - 5.0 * speed + 20.0);
    angle += YAW_PERIOD * speed;
}

int main(int argc, char **argv)
{
    const double seconds = (argc > 1) ? atof(argv[1]) : 3.0;
    const long period = (long)lround(YAW_PERIOD * (double)NANOSECONDS);
    yaw_state controller;
    struct timespec next;
    long k;
    if (yaw_init(&controller, (double)NAN, 0.0) != YAW_READY)
    {
        (void)fputs("this build computes in another way: add -ffp-contract=off\n", stderr);
        return 1;
    }
    (void)clock_gettime(CLOCK_MONOTONIC, &next);
    for (k = 0; k < lround(seconds / YAW_PERIOD); k++)
    {
        const double reference[YAW_REFERENCES] = {1.0, 0.0, 0.0};
        double y;
        double u;
        if (read_angle(&y))
        {
            u = yaw_step(&controller, y, reference, (double)NAN);
        }
        else
        {
            u = yaw_no_sample(&controller);
        }
        write_voltage(u);
        next.tv_nsec += period;
        if (next.tv_nsec >= NANOSECONDS)
        {
            next.tv_nsec -= NANOSECONDS;
            next.tv_sec++;
        }
        (void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
    }
    (void)printf("angle %.4f rad, voltage %.3f V, mode %d\n", angle, (double)controller.command,
                 (int)yaw_mode(&controller));
    return (fabs(angle - 1.0) < 0.01) ? 0 : 1;
}
