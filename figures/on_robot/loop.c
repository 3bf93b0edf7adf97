/* The control loop of a robot: measurements come in by lines, commands go out by lines.
 *
 *   in:   step x y theta
 *   out:  status input speed turn
 *
 * On a robot the two lines are a sensor and a motor, and a timer calls the loop every sdhj_robot_delta seconds.
 */
#include <stdio.h>

#include "sdhj.h"
#include "sdhj_robot.h"

static union {
  double first; /* so that the bytes are aligned; any address would do */
  unsigned char bytes[SDHJ_ROBOT_BYTES];
} file;

int main(int argc, char **argv) {
  sdhj_table table;
  unsigned step;
  double state[SDHJ_ROBOT_AXES];
  FILE *in = argc > 1 ? fopen(argv[1], "rb") : NULL;
  size_t size = in ? fread(file.bytes, 1, sizeof file.bytes, in) : 0;
  if (in) fclose(in);
  if (sdhj_open(&table, file.bytes, size, sdhj_robot_digest) != SDHJ_OK || sdhj_selftest(&table) != 0) {
    fprintf(stderr, "this is not the table that the program was built with\n");
    return 1;
  }
#if SDHJ_ROBOT_ARRIVES
  table.arrived = sdhj_robot_arrived;
#endif
  while (scanf("%u %lf %lf %lf", &step, &state[0], &state[1], &state[2]) == 4) {
    uint32_t input;
    const sdhj_status status = sdhj_select(&table, step, state, &input); /* the braking input where there is none */
    printf("%d %u %.17g %.17g\n", (int)status, (unsigned)input, sdhj_robot_inputs[input][0], sdhj_robot_inputs[input][1]);
    fflush(stdout);
  }
  return 0;
}
