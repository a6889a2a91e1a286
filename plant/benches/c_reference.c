/* The hydrostatic transmission without effects, by the scheme of src/transmission/plant, in plain C: what the Rust is
 * measured against. Reads parameters from the command line, in the order of `arguments` in c_reference.rs; simulates the same
 * record several times; prints the nanoseconds of each run and the final state, so that the bench can see that both
 * computed the same. */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define OUTPUT_STEP 0.5e-3

typedef struct {
    double at_rest, falling, corner, above_corner, rising;
} stribeck;

typedef struct {
    double velocity, displacement, dissipated;
} moved;

typedef struct {
    double half_line[2], displacement[2], inertia[2], fluid_mass, port_damping;
    double laminar, reynolds_per_speed, turbulent, roughness;
    double torque_per_volt, motor_coulomb, motor_viscous;
    stribeck piston, slave;
    double longest_step;
} machine;

typedef struct {
    double time, position[2], velocity[2], line_position[2], line_velocity[2], increment[4];
    double input, dissipated, throughput;
} state;

static double level(const stribeck *law, double speed) {
    speed = fabs(speed);
    double value = speed < law->corner ? law->at_rest - law->falling * speed
                                       : law->above_corner + law->rising * (speed - law->corner);
    return value > 0.0 ? value : 0.0;
}

static double haaland(double reynolds, double roughness) {
    double root = -1.8 * log10(pow(roughness / 3.7, 1.11) + 6.9 / reynolds);
    return 1.0 / (root * root);
}

static double pipe(const machine *m, double speed) {
    double reynolds = m->reynolds_per_speed * fabs(speed);
    if (reynolds <= 2000.0) {
        return m->laminar;
    }
    double factor;
    if (reynolds < 4000.0) {
        double part = (reynolds - 2000.0) / 2000.0;
        factor = 64.0 / 2000.0 * (1.0 - part) + haaland(4000.0, m->roughness) * part;
    } else {
        factor = haaland(reynolds, m->roughness);
    }
    return factor * m->turbulent * fabs(speed);
}

static moved start(double step, double force, double inertia, double at_rest, double viscous) {
    double sign = force >= 0.0 ? 1.0 : -1.0;
    double excess = fabs(force) - at_rest;
    moved result = {0.0, 0.0, 0.0};
    if (excess <= 0.0) {
        return result;
    }
    double speed = step * excess / (inertia + 0.5 * step * viscous);
    double mean = 0.5 * speed, displacement = step * mean;
    result.velocity = sign * speed;
    result.displacement = sign * displacement;
    result.dissipated = (at_rest + viscous * mean) * displacement;
    return result;
}

static moved advance(double velocity, double step, double force, double inertia, double moving, double at_rest,
                     double viscous) {
    if (velocity == 0.0) {
        return start(step, force, inertia, at_rest, viscous);
    }
    double sign = velocity > 0.0 ? 1.0 : -1.0, speed = fabs(velocity), driving = sign * force;
    double half = 0.5 * step * viscous;
    double sliding = ((inertia - half) * speed + step * (driving - moving)) / (inertia + half);
    moved result;
    if (sliding >= 0.0) {
        double mean = 0.5 * (speed + sliding), displacement = step * mean;
        result.velocity = sign * sliding;
        result.displacement = sign * displacement;
        result.dissipated = (moving + viscous * mean) * displacement;
        return result;
    }
    double mean = 0.5 * speed;
    double stopping = inertia * speed / (moving - driving + viscous * mean);
    if (stopping > step) {
        stopping = step;
    }
    double displacement = stopping * mean;
    moved rest = start(step - stopping, force, inertia, at_rest, viscous);
    result.velocity = rest.velocity;
    result.displacement = sign * displacement + rest.displacement;
    result.dissipated = (moving + viscous * mean) * displacement + rest.dissipated;
    return result;
}

static void output_step(const machine *m, state *s, double volts, double hand) {
    int count = (int)ceil(OUTPUT_STEP / m->longest_step - 1e-9);
    if (count < 1) {
        count = 1;
    }
    double step = OUTPUT_STEP / count;
    for (int sub = 0; sub < count; sub++) {
        double half[4], mean[4];
        double positions[4] = {s->position[0], s->position[1], s->line_position[0], s->line_position[1]};
        double speeds[4] = {s->velocity[0], s->velocity[1], s->line_velocity[0], s->line_velocity[1]};
        for (int i = 0; i < 4; i++) {
            half[i] = positions[i] + 0.5 * step * speeds[i];
            mean[i] = speeds[i] + 0.5 * s->increment[i];
            if (i < 2 && mean[i] * speeds[i] < 0.0) {
                mean[i] = 0.0;
            }
        }
        double force[2][2], damper[2][2];
        for (int line = 0; line < 2; line++) {
            for (int end = 0; end < 2; end++) {
                double deflection = half[2 + line] - m->displacement[end] * half[end];
                double rate = mean[2 + line] - m->displacement[end] * mean[end];
                damper[line][end] = m->port_damping * rate;
                force[line][end] = m->half_line[end] * deflection + damper[line][end];
            }
        }
        double motor = m->torque_per_volt * volts;
        double drive = m->displacement[0] * (force[0][0] + force[1][0]) + motor;
        moved master = advance(s->velocity[0], step, drive, m->inertia[0], m->motor_coulomb + level(&m->piston, mean[0]),
                               m->motor_coulomb + level(&m->piston, 0.0), m->motor_viscous);
        double work = motor * master.displacement;
        s->input += work;
        s->throughput += fabs(work);
        double transmitted = m->displacement[1] * (force[0][1] + force[1][1]);
        moved slave = advance(s->velocity[1], step, transmitted + hand, m->inertia[1], level(&m->slave, mean[1]),
                              level(&m->slave, 0.0), 0.0);
        work = hand * slave.displacement;
        s->input += work;
        s->throughput += fabs(work);
        s->dissipated += master.dissipated + slave.dissipated;
        double changes[2] = {master.displacement, slave.displacement};
        double before[4] = {s->velocity[0], s->velocity[1], s->line_velocity[0], s->line_velocity[1]};
        for (int line = 0; line < 2; line++) {
            double coefficient = pipe(m, mean[2 + line]), damping = 0.5 * step * coefficient;
            double after = ((m->fluid_mass - damping) * s->line_velocity[line] -
                            step * (force[line][0] + force[line][1])) / (m->fluid_mass + damping);
            double average = 0.5 * (s->line_velocity[line] + after), displacement = step * average;
            s->dissipated += coefficient * average * displacement;
            for (int end = 0; end < 2; end++) {
                s->dissipated += damper[line][end] * (displacement - m->displacement[end] * changes[end]);
            }
            s->line_position[line] += displacement;
            s->line_velocity[line] = after;
        }
        s->position[0] += master.displacement;
        s->position[1] += slave.displacement;
        s->velocity[0] = master.velocity;
        s->velocity[1] = slave.velocity;
        s->increment[0] = master.velocity == 0.0 ? 0.0 : master.velocity - before[0];
        s->increment[1] = slave.velocity == 0.0 ? 0.0 : slave.velocity - before[1];
        s->increment[2] = s->line_velocity[0] - before[2];
        s->increment[3] = s->line_velocity[1] - before[3];
        s->time += step;
    }
}

static long now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000L + t.tv_nsec;
}

int main(int count, char **words) {
    double v[40];
    if (count != 31) {
        fprintf(stderr, "expected 30 numbers, found %d\n", count - 1);
        return 2;
    }
    for (int i = 1; i < count; i++) {
        v[i - 1] = strtod(words[i], NULL);
    }
    int runs = (int)v[0], steps = (int)v[1];
    machine m = {{v[2], v[3]}, {v[4], v[5]}, {v[6], v[7]}, v[8], v[9], v[10], v[11], v[12], v[13], v[14], v[15], v[16],
                 {v[17], v[18], v[19], v[20], v[21]}, {v[22], v[23], v[24], v[25], v[26]}, v[27]};
    double volts = v[28], hand = v[29];
    state s = {0};
    for (int run = 0; run < runs; run++) {
        state fresh = {0};
        s = fresh;
        long began = now();
        for (int i = 0; i < steps; i++) {
            output_step(&m, &s, volts * sin(i * 0.003), hand * sin(i * 0.0007));
        }
        printf("%ld\n", now() - began);
    }
    printf("state %.17g %.17g %.17g %.17g\n", s.position[0], s.position[1], s.dissipated, s.input);
    return 0;
}
