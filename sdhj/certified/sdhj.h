/* sdhj.h: the controller of a certified table, for any robot. C99 or C++; written with the table by `sdhj export`.
 *
 * A table divides the state space into cells. For every state of a cell, every disturbance and every instant it is proved
 * how many steps lead to the target, and which inputs are safe. This header reads what is proved; it computes nothing.
 * It allocates nothing, keeps nothing, calls nothing of libm, does not recurse, and every loop ends.
 *
 *   sdhj_table table;
 *   if (sdhj_open(&table, bytes, size, sdhj_robot_digest) != SDHJ_OK) stop();    once; sdhj_robot.h has the digest
 *   every delta seconds:
 *     status = sdhj_select(&table, step, state, &input);                  state: double[axes], step: 0, 1, ..., N
 *     apply(sdhj_robot_inputs[input]);                  where status is none of SDHJ_OK this is the braking input
 *
 * Where nothing depends on time, steps are ignored and a loop may go on without end. A state within 1e-10 of a cell
 * (of the axis's largest coordinate) counts as in it, as in the proof. Controllers without floating point define SDHJ_NO_FLOAT and ask by the cell
 * (`sdhj_cell`, then functions whose names end in _at). No function changes the table: threads may share it.
 *
 * That a state is in the target itself, in a cell that is not as a whole, no cell can say: once the table is open,
 *   table.arrived = sdhj_robot_arrived;                                     where SDHJ_ROBOT_ARRIVES is 1; it needs -lm
 * then it has 0 steps to go, and where no input is proved to lead back the status is SDHJ_IN_TARGET.
 *
 * A table for a controller that remembers (SDHJ_ROBOT_REMEMBERS) is asked by a loop, once for each measurement:
 *   sdhj_memory memory = {0};                                            anew for each loop, and after a missed deadline
 *   status = sdhj_step(&table, &memory, step, measurement, &input);
 * or by its parts: `sdhj_remember`, a function that ends in _at, and `sdhj_applied` with whatever input was applied. What
 * is asked with measurements alone, as above, would be proved for one interval and promise nothing beyond it: the status
 * is SDHJ_NOT_CARRIED. A first measurement is asked about by `sdhj_remember` with a new memory.
 */
#ifndef SDHJ_H
#define SDHJ_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define SDHJ_VERSION 1u   /* of the file */
#define SDHJ_REMEMBERS 2u /* of a file that has images, too, for a controller that remembers */
#define SDHJ_AXES 6u      /* at most */
#define SDHJ_HEAD 560u    /* bytes of the file before the words */
#define SDHJ_NO_INPUT 65535u  /* in a word: no input is proved */
#define SDHJ_ARRIVED 65534u   /* in a word: in the target, and none is proved to stay in it */

typedef enum {
  SDHJ_OK = 0,             /* what is asked for is proved */
  SDHJ_IN_TARGET = 1,      /* the task is done; no input is proved to stay in the target, and none is needed */
  SDHJ_NOT_PROVED = -1,    /* of this cell nothing of the kind is proved */
  SDHJ_OFF_GRID = -2,      /* past an end of the grid */
  SDHJ_PAST_SAFE_END = -3, /* past an end where the task is over */
  SDHJ_NOT_FINITE = -4,    /* a coordinate is no number */
  SDHJ_LAST_STEP = -5,     /* step N or later: no interval is left */
  SDHJ_BAD_TABLE = -6,     /* damaged, cut short, of another version or of another robot */
  SDHJ_BAD_ARGUMENT = -7,  /* no such cell or input */
  SDHJ_LEFT_OUT = -8,      /* the table was exported without this (--only) */
  SDHJ_NOT_CARRIED = -9    /* a measurement by itself, where the table is for a loop that remembers: ask sdhj_step */
} sdhj_status;

/* What a word has, in this order; bits of sdhj_table.fields. */
enum { SDHJ_STEPS = 1, SDHJ_SELECT = 2, SDHJ_SAFE = 4, SDHJ_FILTER = 8, SDHJ_CLEAR = 16 };

/* An open table: numbers of its file, and where its parts begin. Read it, do not write it. */
typedef struct {
  const uint8_t *words, *inputs, *order, *index, *directory, *bodies, *images, *tests;
  uint32_t axes, count_of_inputs, components, steps, starts, fields, brake, mask; /* mask: bytes */
  uint32_t word_bytes, number_of_words, id_bytes, index_bytes, at_bytes, blocks, number_of_bodies, number_of_tests;
  uint32_t count[6], side[6], grid[6]; /* cells, of a block, blocks */
  uint32_t periodic[6], layers[6], safe_ends[6];  /* bits of the last two: lower end 1, upper end 2 */
  int told;       /* measurements err, and a layer is for points that are known to be at a wall */
  uint32_t leads; /* steps whose images differ, 0 where there are none */
  uint32_t reads[6], begins[6]; /* axes that an image along one depends on, as bits; where those of an axis begin */
#ifndef SDHJ_NO_FLOAT
  double lower[6], width[6], length[6], error[6], upper[6], slack[6], delta;
  int (*arrived)(uint32_t step, const double *state); /* NULL, or sdhj_robot_arrived: set it after sdhj_open */
#endif
} sdhj_table;

/* The cells that a state is in or within the slack of: on each axis from the first to the last, at most two. */
typedef struct {
  uint32_t first[6], last[6];
} sdhj_place;

/* ---- numbers of the file, little-endian, at any address */

static inline uint32_t sdhj_u16(const uint8_t *at) { return (uint32_t)at[0] | (uint32_t)at[1] << 8; }

static inline uint32_t sdhj_u32(const uint8_t *at) { return sdhj_u16(at) | sdhj_u16(at + 2) << 16; }

static inline uint32_t sdhj_number(const uint8_t *at, uint32_t bytes) { /* of 1 to 4 bytes */
  uint32_t value = at[0];
  if (bytes > 1) value |= (uint32_t)at[1] << 8;
  if (bytes > 2) value |= (uint32_t)at[2] << 16;
  if (bytes > 3) value |= (uint32_t)at[3] << 24;
  return value;
}

static inline uint32_t sdhj_crc(uint32_t crc, const uint8_t *at, size_t count) { /* CRC-32, four bits at a time */
  static const uint32_t step[16] = {
      0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u, 0x4db26158u, 0x5005713cu,
      0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu, 0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu};
  size_t i;
  for (i = 0; i < count; i++) {
    crc = step[(crc ^ at[i]) & 15u] ^ (crc >> 4);
    crc = step[(crc ^ ((uint32_t)at[i] >> 4)) & 15u] ^ (crc >> 4);
  }
  return crc;
}

/* ---- words of cells */

static inline uint32_t sdhj_entry(const uint8_t *entries, uint32_t place, uint32_t bits) { /* at most 16 bits */
  const uint32_t at = place * bits;
  const uint8_t *byte = entries + (at >> 3);
  const uint32_t found = sdhj_u16(byte) | (uint32_t)byte[2] << 16;
  return (found >> (at & 7u)) & ((1u << bits) - 1u);
}

/* The word of a cell. A body has the bits of an entry, the length of its palette, the palette, an entry for each cell. */
static inline const uint8_t *sdhj_word(const sdhj_table *t, uint32_t step, const uint32_t *cell) {
  uint32_t block = 0, inside = 0, axis, bits, entry;
  const uint8_t *body;
  for (axis = 0; axis < t->axes; axis++) {
    block = block * t->grid[axis] + cell[axis] / t->side[axis];
    inside = inside * t->side[axis] + cell[axis] % t->side[axis];
  }
  if (t->starts > 1u) block += step * t->blocks;
  block = sdhj_number(t->index + (size_t)block * t->index_bytes, t->index_bytes);
  body = t->bodies + sdhj_number(t->directory + (size_t)block * t->at_bytes, t->at_bytes);
  bits = body[0];
  entry = bits == 0u ? 0u : sdhj_entry(body + 3 + sdhj_u16(body + 1) * t->id_bytes, inside, bits);
  entry = sdhj_number(body + 3 + entry * t->id_bytes, t->id_bytes);
  return t->words + (size_t)entry * t->word_bytes;
}

static inline uint32_t sdhj_offset(const sdhj_table *t, uint32_t field) { /* of a field in a word */
  uint32_t at = 0;
  if (field > SDHJ_STEPS && (t->fields & SDHJ_STEPS)) at += 4u;
  if (field > SDHJ_SELECT && (t->fields & SDHJ_SELECT)) at += 2u;
  if (field > SDHJ_SAFE && (t->fields & SDHJ_SAFE)) at += t->mask;
  if (field > SDHJ_FILTER && (t->fields & SDHJ_FILTER)) at += t->mask;
  return at;
}

static inline int sdhj_has(const uint8_t *mask, uint32_t input) { return mask[input >> 3] >> (input & 7u) & 1; }

/* From one cell of a place to the next, cell[axis] = first or last; 0 behind the last one. */
static inline int sdhj_next(const sdhj_table *t, const sdhj_place *place, uint32_t *cell) {
  uint32_t axis;
  for (axis = 0; axis < t->axes; axis++) {
    if (place->first[axis] != place->last[axis] && cell[axis] == place->first[axis]) {
      cell[axis] = place->last[axis];
      return 1;
    }
    cell[axis] = place->first[axis];
  }
  return 0;
}

/* ---- opening a table */

/* Bytes of the images: of each axis, for each step that has its own, input and cells of the axes that it depends on, from
 * the cell's own number on the first and the last cell that it leads to, two numbers of 16 bits. 2^32 is too many. */
static inline uint64_t sdhj_bytes_of_images(sdhj_table *t) {
  uint64_t all = 0, some;
  uint32_t axis, k;
  for (axis = 0; axis < t->axes; axis++) {
    t->begins[axis] = (uint32_t)all;
    some = (uint64_t)t->leads * t->count_of_inputs;
    for (k = 0; k < t->axes; k++) {
      if (some > UINT32_MAX) return (uint64_t)UINT32_MAX + 1u;
      if (t->reads[axis] >> k & 1u) some *= t->count[k];
    }
    all += some;
    if (all > UINT32_MAX / 4u) return (uint64_t)UINT32_MAX + 1u;
  }
  return 4u * all;
}

/* The parts of a file, one behind the other: writes where they begin; 0 where they do not make up its bytes. */
static inline int sdhj_parts(sdhj_table *t, const uint8_t *file, size_t size, uint32_t bytes_of_bodies) {
  uint64_t at = SDHJ_HEAD, sizes[8];
  const uint8_t **part[8];
  uint32_t i;
  part[0] = &t->words, part[1] = &t->inputs, part[2] = &t->order, part[3] = &t->index;
  part[4] = &t->directory, part[5] = &t->bodies, part[6] = &t->images, part[7] = &t->tests;
  sizes[0] = (uint64_t)t->number_of_words * t->word_bytes;
  sizes[1] = (uint64_t)t->count_of_inputs * t->components * 8u;
  sizes[2] = (uint64_t)t->count_of_inputs * 2u;
  sizes[3] = (uint64_t)t->blocks * t->starts * t->index_bytes;
  sizes[4] = (uint64_t)t->number_of_bodies * t->at_bytes;
  sizes[5] = bytes_of_bodies;
  sizes[6] = sdhj_bytes_of_images(t);
  sizes[7] = (uint64_t)t->number_of_tests * (2u * t->axes + 2u);
  for (i = 0; i < 8u; i++) {
    *part[i] = file + at;
    at += (sizes[i] + 7u) / 8u * 8u; /* parts begin at multiples of 8 */
    if (sizes[i] > UINT32_MAX || at > size) return 0;
  }
  return at == size;
}

static inline int sdhj_words_fit(const sdhj_table *t) {
  static const uint32_t masks[3] = {SDHJ_SAFE, SDHJ_FILTER, SDHJ_CLEAR};
  const uint32_t spare = t->mask * 8u - t->count_of_inputs;
  uint32_t i, k, value;
  for (i = 0; i < t->number_of_words; i++) {
    const uint8_t *word = t->words + (size_t)i * t->word_bytes;
    if (t->fields & SDHJ_STEPS) {
      value = sdhj_u32(word);
      if (value > t->steps && value != UINT32_MAX) return 0;
    }
    if (t->fields & SDHJ_SELECT) {
      value = sdhj_u16(word + sdhj_offset(t, SDHJ_SELECT));
      if (value >= t->count_of_inputs && value < SDHJ_ARRIVED) return 0;
    }
    for (k = 0; k < 3u; k++)
      if ((t->fields & masks[k]) && word[sdhj_offset(t, masks[k]) + t->mask - 1u] >> (8u - spare)) return 0;
  }
  return 1;
}

static inline int sdhj_bodies_fit(const sdhj_table *t, uint32_t cells, uint32_t bytes_of_bodies) {
  uint32_t i, k;
  uint64_t at = 0;
  for (i = 0; i < t->number_of_bodies; i++) {
    const uint8_t *body = t->bodies + at;
    uint32_t bits, count;
    if (at + 3u > bytes_of_bodies) return 0;
    if (sdhj_number(t->directory + (size_t)i * t->at_bytes, t->at_bytes) != at) return 0;
    bits = body[0], count = sdhj_u16(body + 1);
    at += 3u + (uint64_t)count * t->id_bytes + ((uint64_t)cells * bits + 7u) / 8u;
    if (bits > 16u || count < 1u || count > 1u << bits || at + 2u > bytes_of_bodies) return 0; /* 2: read with the last */
    for (k = 0; k < count; k++)
      if (sdhj_number(body + 3 + (size_t)k * t->id_bytes, t->id_bytes) >= t->number_of_words) return 0;
    for (k = 0; k < cells && count < 1u << bits; k++)
      if (sdhj_entry(body + 3 + count * t->id_bytes, k, bits) >= count) return 0;
  }
  if (at + 2u != bytes_of_bodies) return 0;
  for (i = 0; i < t->blocks * t->starts; i++)
    if (sdhj_number(t->index + (size_t)i * t->index_bytes, t->index_bytes) >= t->number_of_bodies) return 0;
  return 1;
}

#ifndef SDHJ_NO_FLOAT
typedef char sdhj_needs_doubles_of_64_bits_or_SDHJ_NO_FLOAT[sizeof(double) == 8 ? 1 : -1];

static inline double sdhj_f64(const uint8_t *at) {
  const uint64_t bits = (uint64_t)sdhj_u32(at) | (uint64_t)sdhj_u32(at + 4) << 32;
  double value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static inline int sdhj_between(double value, double low, double high) { return value >= low && value <= high; }

static inline int sdhj_axes_fit(sdhj_table *t, const uint8_t *file) {
  uint32_t axis, i, most = t->count_of_inputs * t->components;
  for (axis = 0; axis < t->axes; axis++) {
    const uint8_t *at = file + 256u + 8u * axis;
    t->lower[axis] = sdhj_f64(at), t->width[axis] = sdhj_f64(at + 48), t->length[axis] = sdhj_f64(at + 96);
    t->error[axis] = sdhj_f64(at + 144), t->upper[axis] = sdhj_f64(at + 192), t->slack[axis] = sdhj_f64(at + 240);
    if (!sdhj_between(t->slack[axis], 0.0, t->length[axis])) return 0;
    if (!sdhj_between(t->lower[axis], -1e300, 1e300) || !sdhj_between(t->upper[axis], t->lower[axis], 1e300)) return 0;
    if (!sdhj_between(t->width[axis], 1e-300, 1e300) || !sdhj_between(t->length[axis], t->width[axis] / 2, 1e300)) return 0;
    t->told |= t->leads > 0u && t->error[axis] > 0.0;
    if (!sdhj_between(t->error[axis], 0.0, 1e300) || t->width[axis] * t->count[axis] < t->length[axis] * 0.999999) return 0;
  }
  t->delta = sdhj_f64(file + 544);
  for (i = 0; i < most; i++)
    if (!sdhj_between(sdhj_f64(t->inputs + (size_t)i * 8u), -1e150, 1e150)) return 0;
  return sdhj_between(t->delta, 1e-300, 1e300);
}
#endif

/* Look at every byte of a table of so many bytes and note where its parts are; the bytes must stay as they are.
 * digest: sdhj_robot_digest of the header that was written with it, 32 bytes; NULL takes any table. */
static inline sdhj_status sdhj_open(sdhj_table *t, const void *bytes, size_t size, const uint8_t *digest) {
  const uint8_t *file = (const uint8_t *)bytes;
  uint64_t blocks = 1, cells = 1;
  uint32_t axis, i, fields = 0, bytes_of_bodies, version;
  memset(t, 0, sizeof *t);
  if (bytes == NULL || size < SDHJ_HEAD || size > UINT32_MAX) return SDHJ_BAD_TABLE;
  version = sdhj_u32(file + 8);
  if (memcmp(file, "sdhjcell", 8) != 0 || sdhj_u32(file + 16) != size) return SDHJ_BAD_TABLE;
  if (version != SDHJ_VERSION && version != SDHJ_REMEMBERS) return SDHJ_BAD_TABLE;
  if ((sdhj_crc(sdhj_crc(0xffffffffu, file, 12), file + 16, size - 16) ^ 0xffffffffu) != sdhj_u32(file + 12))
    return SDHJ_BAD_TABLE;
  if (digest != NULL && memcmp(file + 128, digest, 32) != 0) return SDHJ_BAD_TABLE;
  t->axes = sdhj_u32(file + 20), t->count_of_inputs = sdhj_u32(file + 24), t->components = sdhj_u32(file + 28);
  t->steps = sdhj_u32(file + 32), t->starts = sdhj_u32(file + 36), t->fields = sdhj_u32(file + 40);
  t->brake = sdhj_u32(file + 44), t->word_bytes = sdhj_u32(file + 48), t->number_of_words = sdhj_u32(file + 52);
  t->id_bytes = sdhj_u32(file + 56), t->index_bytes = sdhj_u32(file + 60), t->number_of_bodies = sdhj_u32(file + 64);
  bytes_of_bodies = sdhj_u32(file + 68), t->number_of_tests = sdhj_u32(file + 72), t->at_bytes = sdhj_u32(file + 76);
  if (t->axes < 1u || t->axes > SDHJ_AXES || t->count_of_inputs < 1u || t->count_of_inputs > 65533u) return SDHJ_BAD_TABLE;
  if (t->components < 1u || t->components > 65535u || t->brake >= t->count_of_inputs) return SDHJ_BAD_TABLE;
  if (t->steps < 1u || t->steps > 0x7fffffffu || (t->starts != 1u && t->starts != t->steps + 1u)) return SDHJ_BAD_TABLE;
  if (t->fields < 1u || t->fields > 31u || t->id_bytes < 1u || t->id_bytes > 4u) return SDHJ_BAD_TABLE;
  if (t->index_bytes < 1u || t->index_bytes > 4u || t->at_bytes < 1u || t->at_bytes > 4u) return SDHJ_BAD_TABLE;
  if (t->number_of_words < 1u || t->number_of_bodies < 1u) return SDHJ_BAD_TABLE;
  t->leads = sdhj_u32(file + 80);
  if (version == SDHJ_VERSION ? t->leads != 0u : t->leads != 1u && t->leads + 1u != t->starts) return SDHJ_BAD_TABLE;
  t->mask = (t->count_of_inputs + 7u) / 8u;
  fields = sdhj_offset(t, SDHJ_CLEAR) + (t->fields & SDHJ_CLEAR ? t->mask : 0u);
  if (t->word_bytes != fields) return SDHJ_BAD_TABLE;
  for (axis = 0; axis < t->axes; axis++) {
    t->count[axis] = sdhj_u32(file + 160 + 4u * axis), t->side[axis] = sdhj_u32(file + 184 + 4u * axis);
    t->periodic[axis] = sdhj_u32(file + 208 + 4u * axis), t->safe_ends[axis] = sdhj_u32(file + 232 + 4u * axis);
    t->reads[axis] = t->periodic[axis] >> 8, t->layers[axis] = t->periodic[axis] >> 1 & 127u, t->periodic[axis] &= 1u;
    if (t->reads[axis] >> t->axes || (t->reads[axis] && !t->leads)) return SDHJ_BAD_TABLE;
    if (t->count[axis] < 1u || t->count[axis] > 0x7ffffffeu || t->side[axis] < 1u || t->side[axis] > 65536u) return SDHJ_BAD_TABLE;
    if (t->layers[axis] > 3u || (t->periodic[axis] && t->layers[axis]) || t->safe_ends[axis] > 3u) return SDHJ_BAD_TABLE;
    t->grid[axis] = (t->count[axis] - 1u) / t->side[axis] + 1u;
    blocks *= t->grid[axis], cells *= t->side[axis];
    if (cells > 65536u || blocks * t->starts > UINT32_MAX) return SDHJ_BAD_TABLE;
  }
  t->blocks = (uint32_t)blocks;
  if (!sdhj_parts(t, file, size, bytes_of_bodies)) return SDHJ_BAD_TABLE;
  for (i = 0; i < t->count_of_inputs; i++)
    if (sdhj_u16(t->order + 2u * i) >= t->count_of_inputs) return SDHJ_BAD_TABLE;
  if (!sdhj_words_fit(t) || !sdhj_bodies_fit(t, (uint32_t)cells, bytes_of_bodies)) return SDHJ_BAD_TABLE;
#ifndef SDHJ_NO_FLOAT
  if (!sdhj_axes_fit(t, file)) return SDHJ_BAD_TABLE;
#endif
  return SDHJ_OK;
}

/* ---- where a state is */

/* The place of one cell, its number on each axis: of encoder counts, for example. On an axis with a layer at its lower
 * end (layers & 1) cell 0 is the wall itself, and those of some width begin with 1. A loop that remembers carries no cells. */
static inline sdhj_status sdhj_cell(const sdhj_table *t, const uint32_t *cell, sdhj_place *place) {
  uint32_t axis;
  if (t->leads > 0u) return SDHJ_NOT_CARRIED;
  for (axis = 0; axis < t->axes; axis++) {
    if (cell[axis] >= t->count[axis]) return SDHJ_BAD_ARGUMENT;
    place->first[axis] = place->last[axis] = cell[axis];
  }
  return SDHJ_OK;
}

#ifndef SDHJ_NO_FLOAT
static inline double sdhj_floor(double value) { /* of less than 1e15 */
  const double whole = (double)(int64_t)value;
  return whole > value ? whole - 1.0 : whole;
}

static inline double sdhj_clipped(const sdhj_table *t, uint32_t axis, double x) {
  const double upper = t->upper[axis], lower = t->lower[axis] + (t->layers[axis] & 1u ? t->width[axis] : 0.0);
  return t->periodic[axis] ? x : x < lower ? lower : x > upper ? upper : x;
}

/* A state as it is looked up. Where the problem has a measurement error this is a measurement, which is clipped to the
 * grid where it is off it by no more than that. */
static inline sdhj_status sdhj_seen(const sdhj_table *t, const double *state, double *seen) {
  uint32_t axis;
  int senses = 0, off = 0;
  for (axis = 0; axis < t->axes; axis++) {
    const double x = state[axis], beside = x - sdhj_clipped(t, axis, x);
    volatile double most = t->error[axis] * (1.0 + 1e-9); /* volatile: never a fused multiply-add, so bits are alike */
    if (!sdhj_between(x, -1.7976931348623157e308, 1.7976931348623157e308)) return SDHJ_NOT_FINITE;
    senses |= t->error[axis] > 0.0;
    off |= beside > most || -beside > most;
  }
  for (axis = 0; axis < t->axes; axis++) seen[axis] = senses && !off ? sdhj_clipped(t, axis, state[axis]) : state[axis];
  return SDHJ_OK;
}

/* The cells of a point that is looked up, in the axes' units. */
static inline sdhj_status sdhj_place_of(const sdhj_table *t, const double *point, sdhj_place *place) {
  sdhj_status status = SDHJ_OK;
  uint32_t axis;
  for (axis = 0; axis < t->axes; axis++) {
    const double x = point[axis];
    const double length = t->length[axis], slack = t->slack[axis], most = (double)(t->count[axis] - 1u);
    /* a layer is a cell that stands for a wall alone and lies behind it */
    const double begin = t->layers[axis] & 1u ? t->width[axis] : 0.0;
    const double end = t->layers[axis] & 2u ? length - t->width[axis] : length;
    double offset = x - t->lower[axis], below, above, first, last;
    if (t->periodic[axis]) {
      const double laps = offset / length;
      volatile double turned;
      if (!sdhj_between(laps, -1e9, 1e9)) return SDHJ_OFF_GRID; /* farther than numbers tell cells apart */
      turned = length * sdhj_floor(laps);
      offset -= turned;
    } else if (offset < begin - slack || offset > end + slack) {
      if (status != SDHJ_OFF_GRID && (t->safe_ends[axis] & (offset < begin ? 1u : 2u))) status = SDHJ_PAST_SAFE_END;
      else status = SDHJ_OFF_GRID;
      continue;
    }
    below = offset - slack, above = offset + slack;
    first = below / t->width[axis], last = above / t->width[axis];
    first = first < 0.0 ? 0.0 : first > most ? most : first;
    last = last < 0.0 ? 0.0 : last > most ? most : last;
    if (t->told) { /* a layer is for points that say so, behind the wall by half the slack */
      if (t->layers[axis] & 1u) {
        if (offset < begin - slack / 4.0) last = 0.0;
        else first = first < 1.0 ? 1.0 : first, last = last < 1.0 ? 1.0 : last;
      }
      if (t->layers[axis] & 2u) {
        if (offset > end + slack / 4.0) first = most;
        else first = first > most - 1.0 ? most - 1.0 : first, last = last > most - 1.0 ? most - 1.0 : last;
      }
    }
    place->first[axis] = t->periodic[axis] && below < 0.0 ? t->count[axis] - 1u : (uint32_t)first;
    place->last[axis] = t->periodic[axis] && above >= length ? 0u : (uint32_t)last;
  }
  return status;
}

/* The cells of a state, or of a first measurement. */
static inline sdhj_status sdhj_locate(const sdhj_table *t, const double *state, sdhj_place *place) {
  double seen[SDHJ_AXES];
  const sdhj_status status = sdhj_seen(t, state, seen);
  return status != SDHJ_OK ? status : sdhj_place_of(t, seen, place);
}

/* The cells of a state that more is asked about than one interval, which a loop that remembers must have carried on. */
static inline sdhj_status sdhj_locate_alone(const sdhj_table *t, const double *state, sdhj_place *place) {
  return t->leads > 0u ? SDHJ_NOT_CARRIED : sdhj_locate(t, state, place);
}
#endif

/* ---- answers; *input is the braking input wherever the status is not SDHJ_OK */

/* The fewest steps within which the target is reached; without a target N where the robot stays clear so long. */
static inline sdhj_status sdhj_steps_to_go_at(const sdhj_table *t, uint32_t step, const sdhj_place *place, uint32_t *steps) {
  uint32_t cell[SDHJ_AXES];
  *steps = UINT32_MAX;
  if (!(t->fields & SDHJ_STEPS)) return SDHJ_LEFT_OUT;
  if (t->starts > 1u && step > t->steps) return SDHJ_LAST_STEP;
  memcpy(cell, place->first, sizeof cell);
  do {
    const uint32_t own = sdhj_u32(sdhj_word(t, step, cell));
    if (own < *steps) *steps = own;
  } while (sdhj_next(t, place, cell));
  return *steps == UINT32_MAX ? SDHJ_NOT_PROVED : SDHJ_OK;
}

/* How many steps the inputs of a cell leave, for cells of several: those with the fewest count. */
static inline uint32_t sdhj_ahead(const sdhj_table *t, const uint8_t *word) {
  const uint32_t steps = t->fields & SDHJ_STEPS ? sdhj_u32(word) : 1u;
  return steps == 0u ? 1u : steps;
}

static inline sdhj_status sdhj_least_ahead(const sdhj_table *t, uint32_t step, const sdhj_place *place, uint32_t *least) {
  uint32_t cell[SDHJ_AXES];
  int arrived = 0;
  *least = UINT32_MAX;
  if (t->starts > 1u && step >= t->steps) return SDHJ_LAST_STEP;
  memcpy(cell, place->first, sizeof cell);
  do {
    const uint8_t *word = sdhj_word(t, step, cell);
    const uint32_t ahead = sdhj_ahead(t, word);
    if (ahead < *least) *least = ahead;
    if (t->fields & SDHJ_STEPS) arrived |= sdhj_u32(word) == 0u;
    else if (t->fields & SDHJ_SELECT) arrived |= sdhj_u16(word) == SDHJ_ARRIVED;
  } while (sdhj_next(t, place, cell));
  return arrived ? SDHJ_IN_TARGET : *least == UINT32_MAX ? SDHJ_NOT_PROVED : SDHJ_OK;
}

/* The input that the rule of the export prefers, of those that lead to the target in the fewest steps.
 *
 * With one step to go it leads into the target itself, of which cells need not be whole: whoever has held it for delta is
 * there, also where the next answer is SDHJ_NOT_PROVED. */
static inline sdhj_status sdhj_select_at(const sdhj_table *t, uint32_t step, const sdhj_place *place, uint32_t *input) {
  uint32_t cell[SDHJ_AXES], least;
  sdhj_status status;
  *input = t->brake;
  if (!(t->fields & SDHJ_SELECT)) return SDHJ_LEFT_OUT;
  status = sdhj_least_ahead(t, step, place, &least);
  if (status < 0) return status;
  memcpy(cell, place->first, sizeof cell);
  do {
    const uint8_t *word = sdhj_word(t, step, cell);
    const uint32_t own = sdhj_u16(word + sdhj_offset(t, SDHJ_SELECT));
    if (sdhj_ahead(t, word) == least && own < SDHJ_ARRIVED) {
      *input = own;
      return SDHJ_OK;
    }
  } while (sdhj_next(t, place, cell));
  return status == SDHJ_OK ? SDHJ_NOT_PROVED : status;
}

/* A field of inputs as bits, `mask` bytes, input j being bit j % 8 of byte j / 8: united over the cells that count. */
static inline sdhj_status sdhj_inputs_at(const sdhj_table *t, uint32_t step, const sdhj_place *place, uint32_t field, uint8_t *bits) {
  uint32_t cell[SDHJ_AXES], least, i, some = 0;
  sdhj_status status;
  memset(bits, 0, t->mask);
  if (!(t->fields & field)) return SDHJ_LEFT_OUT;
  status = sdhj_least_ahead(t, step, place, &least);
  if (status == SDHJ_LAST_STEP) return status;
  memcpy(cell, place->first, sizeof cell);
  do {
    const uint8_t *word = sdhj_word(t, step, cell), *own = word + sdhj_offset(t, field);
    if (field != SDHJ_SAFE || sdhj_ahead(t, word) == least)
      for (i = 0; i < t->mask; i++) some |= bits[i] = (uint8_t)(bits[i] | own[i]);
  } while (sdhj_next(t, place, cell));
  return some ? SDHJ_OK : field != SDHJ_CLEAR && status == SDHJ_IN_TARGET ? status : SDHJ_NOT_PROVED;
}

/* The proved inputs that lead to the target in the fewest steps, as bits. */
static inline sdhj_status sdhj_safe_inputs_at(const sdhj_table *t, uint32_t step, const sdhj_place *place, uint8_t *bits) {
  return sdhj_inputs_at(t, step, place, SDHJ_SAFE, bits);
}

/* The inputs that are proved to stay clear for one interval, as bits. */
static inline sdhj_status sdhj_clear_inputs_at(const sdhj_table *t, uint32_t step, const sdhj_place *place, uint8_t *bits) {
  return sdhj_inputs_at(t, step, place, SDHJ_CLEAR, bits);
}

/* For where nothing else is proved: of the inputs that stay clear for one interval the nearest to the braking input. */
static inline sdhj_status sdhj_fallback_at(const sdhj_table *t, uint32_t step, const sdhj_place *place, uint32_t *input) {
  uint32_t cell[SDHJ_AXES], i;
  *input = t->brake;
  if (!(t->fields & SDHJ_CLEAR)) return SDHJ_LEFT_OUT;
  if (t->starts > 1u && step >= t->steps) return SDHJ_LAST_STEP;
  for (i = 0; i < t->count_of_inputs; i++) {
    const uint32_t own = sdhj_u16(t->order + 2u * i);
    memcpy(cell, place->first, sizeof cell);
    do {
      if (sdhj_has(sdhj_word(t, step, cell) + sdhj_offset(t, SDHJ_CLEAR), own)) {
        *input = own;
        return SDHJ_OK;
      }
    } while (sdhj_next(t, place, cell));
  }
  return SDHJ_NOT_PROVED;
}

#ifndef SDHJ_NO_FLOAT
/* The wanted input, by number or else by the command (components,) that is wanted, if after it the target can still be
 * reached within all steps; else the nearest such input, of least Euclidean distance, the first of equals. */
static inline sdhj_status sdhj_filter_at(const sdhj_table *t, uint32_t step, const sdhj_place *place, uint32_t wanted, const double *command, uint32_t *input) {
  uint32_t cell[SDHJ_AXES], least, i, k;
  double nearest = -2.0;
  sdhj_status status;
  *input = t->brake;
  if (!(t->fields & SDHJ_FILTER)) return SDHJ_LEFT_OUT;
  if (command == NULL && wanted >= t->count_of_inputs) return SDHJ_BAD_ARGUMENT;
  for (k = 0; command != NULL && k < t->components; k++)
    if (!sdhj_between(command[k], -1.7976931348623157e308, 1.7976931348623157e308)) return SDHJ_BAD_ARGUMENT;
  status = sdhj_least_ahead(t, step, place, &least);
  if (status == SDHJ_LAST_STEP) return status;
  memcpy(cell, place->first, sizeof cell);
  do {
    const uint8_t *proved = sdhj_word(t, step, cell) + sdhj_offset(t, SDHJ_FILTER);
    for (i = 0; i < t->count_of_inputs; i++) {
      double distance = 0.0;
      if (!sdhj_has(proved, i)) continue;
      for (k = 0; k < t->components; k++) {
        const uint8_t *own = t->inputs + (size_t)k * 8u;
        const double want = command != NULL ? command[k] : sdhj_f64(own + (size_t)wanted * t->components * 8u);
        const double apart = sdhj_f64(own + (size_t)i * t->components * 8u) - want;
        volatile double square = apart * apart;
        distance += square;
      }
      if (command == NULL && i == wanted) distance = -1.0;
      if (nearest < -1.5 || distance < nearest || (distance <= nearest && i < *input)) nearest = distance, *input = i;
    }
  } while (sdhj_next(t, place, cell));
  return nearest > -1.5 ? SDHJ_OK : status == SDHJ_IN_TARGET ? status : SDHJ_NOT_PROVED;
}

/* ---- the same of a state, (axes,) in the units of the axes; where the table is for a loop that remembers, only
 * sdhj_clear_inputs and sdhj_fallback, which speak of one interval */

/* Whether a state on the grid is in the target itself, where the table has been told how to see it. */
static inline int sdhj_there(const sdhj_table *t, uint32_t step, const double *state) {
  return t->arrived != NULL && t->arrived(t->starts > 1u ? step : 0u, state);
}

/* Whether of a state in the target inputs are not asked, as its cell has none, or only such as leave more than one step. */
static inline int sdhj_done(const sdhj_table *t, uint32_t step, const double *state, const sdhj_place *place, sdhj_status status) {
  uint32_t least;
  if ((status != SDHJ_OK && status != SDHJ_NOT_PROVED) || !sdhj_there(t, step, state)) return 0;
  return status == SDHJ_NOT_PROVED || (sdhj_least_ahead(t, step, place, &least) == SDHJ_OK && least > 1u);
}

static inline sdhj_status sdhj_steps_to_go(const sdhj_table *t, uint32_t step, const double *state, uint32_t *steps) {
  sdhj_place place;
  sdhj_status status = sdhj_locate_alone(t, state, &place);
  *steps = UINT32_MAX;
  if (status != SDHJ_OK) return status;
  status = sdhj_steps_to_go_at(t, step, &place, steps);
  if ((status != SDHJ_OK && status != SDHJ_NOT_PROVED) || !sdhj_there(t, step, state)) return status;
  *steps = 0;
  return SDHJ_OK;
}

static inline sdhj_status sdhj_select(const sdhj_table *t, uint32_t step, const double *state, uint32_t *input) {
  sdhj_place place;
  sdhj_status status = sdhj_locate_alone(t, state, &place);
  *input = t->brake;
  if (status != SDHJ_OK) return status;
  status = sdhj_select_at(t, step, &place, input);
  if (!sdhj_done(t, step, state, &place, status)) return status;
  *input = t->brake;
  return SDHJ_IN_TARGET;
}

static inline sdhj_status sdhj_safe_inputs(const sdhj_table *t, uint32_t step, const double *state, uint8_t *bits) {
  sdhj_place place;
  sdhj_status status = sdhj_locate_alone(t, state, &place);
  memset(bits, 0, t->mask);
  if (status != SDHJ_OK) return status;
  status = sdhj_safe_inputs_at(t, step, &place, bits);
  if (!sdhj_done(t, step, state, &place, status)) return status;
  memset(bits, 0, t->mask);
  return SDHJ_IN_TARGET;
}

static inline sdhj_status sdhj_clear_inputs(const sdhj_table *t, uint32_t step, const double *state, uint8_t *bits) {
  sdhj_place place;
  const sdhj_status status = sdhj_locate(t, state, &place);
  memset(bits, 0, t->mask);
  return status != SDHJ_OK ? status : sdhj_clear_inputs_at(t, step, &place, bits);
}

static inline sdhj_status sdhj_fallback(const sdhj_table *t, uint32_t step, const double *state, uint32_t *input) {
  sdhj_place place;
  const sdhj_status status = sdhj_locate(t, state, &place);
  *input = t->brake;
  return status != SDHJ_OK ? status : sdhj_fallback_at(t, step, &place, input);
}

static inline sdhj_status sdhj_filter(const sdhj_table *t, uint32_t step, const double *state, uint32_t wanted, uint32_t *input) {
  sdhj_place place;
  sdhj_status status = sdhj_locate_alone(t, state, &place);
  *input = t->brake;
  if (status != SDHJ_OK) return status;
  status = sdhj_filter_at(t, step, &place, wanted, NULL, input);
  return status == SDHJ_NOT_PROVED && sdhj_there(t, step, state) ? SDHJ_IN_TARGET : status;
}

static inline sdhj_status sdhj_filter_command(const sdhj_table *t, uint32_t step, const double *state, const double *command, uint32_t *input) {
  sdhj_place place;
  sdhj_status status = sdhj_locate_alone(t, state, &place);
  *input = t->brake;
  if (status != SDHJ_OK) return status;
  status = sdhj_filter_at(t, step, &place, 0, command, input);
  return status == SDHJ_NOT_PROVED && sdhj_there(t, step, state) ? SDHJ_IN_TARGET : status;
}

/* ---- a loop that remembers */

/* What a loop carries from a measurement to the next: where it took the state to be, and between what points it goes on.
 * All zero before the first, and after a deadline that was missed. */
typedef struct {
  double point[6], low[6], high[6];
  int begun, missed; /* missed: the last measurement was farther off than errors explain, and the loop began anew with it */
} sdhj_memory;

static inline double sdhj_edge(const sdhj_table *t, uint32_t axis, int64_t number) { /* where a cell begins, over seams too */
  const int64_t count = (int64_t)t->count[axis];
  int64_t laps = 0;
  volatile double turned, at;
  double edge;
  if (t->periodic[axis]) laps = number >= 0 ? number / count : -((count - 1 - number) / count), number -= laps * count;
  turned = (double)laps * t->length[axis];
  at = (double)number * t->width[axis];
  edge = t->lower[axis] + turned;
  edge += at;
  return sdhj_clipped(t, axis, edge);
}

static inline double sdhj_behind(const sdhj_table *t, uint32_t axis, int lower) { /* the point of a layer */
  const double end = t->layers[axis] & 2u ? t->length[axis] - t->width[axis] : t->length[axis];
  if (lower) return t->lower[axis] + t->width[axis] - 0.5 * t->slack[axis];
  return t->lower[axis] + end + 0.5 * t->slack[axis];
}

/* The cell of a place that speaks for an input: of those in which it is proved that with the fewest steps to go. */
static inline void sdhj_claimed(const sdhj_table *t, uint32_t step, const sdhj_place *place, uint32_t input, uint32_t *best) {
  uint32_t cell[SDHJ_AXES], least = UINT32_MAX;
  memcpy(cell, place->first, sizeof cell);
  do {
    const uint8_t *word = sdhj_word(t, step, cell);
    uint32_t rank = UINT32_MAX - 1u;
    if ((t->fields & SDHJ_FILTER) && sdhj_has(word + sdhj_offset(t, SDHJ_FILTER), input)) rank = UINT32_MAX - 2u;
    if ((t->fields & SDHJ_SELECT) && sdhj_u16(word + sdhj_offset(t, SDHJ_SELECT)) == input) rank = sdhj_ahead(t, word);
    if ((t->fields & SDHJ_SAFE) && sdhj_has(word + sdhj_offset(t, SDHJ_SAFE), input)) rank = sdhj_ahead(t, word);
    if (rank < least) least = rank, memcpy(best, cell, sizeof cell);
  } while (sdhj_next(t, place, cell));
}

/* The first and the last cell along an axis that all of a cell may lead to under an input. */
static inline void sdhj_image(const sdhj_table *t, uint32_t step, const uint32_t *cell, uint32_t input, uint32_t axis, int64_t *first, int64_t *last) {
  uint32_t number = t->leads > 1u ? step * t->count_of_inputs + input : input, k;
  const uint8_t *at;
  for (k = 0; k < t->axes; k++)
    if (t->reads[axis] >> k & 1u) number = number * t->count[k] + cell[k];
  at = t->images + 4u * (size_t)(t->begins[axis] + number);
  *first = (int64_t)cell[axis] + (int16_t)sdhj_u16(at), *last = (int64_t)cell[axis] + (int16_t)sdhj_u16(at + 2);
}

/* Take a measurement: memory->point, which is looked up, and its place. */
static inline sdhj_status sdhj_remember(const sdhj_table *t, sdhj_memory *memory, const double *measurement, sdhj_place *place) {
  double *point = memory->point, seen[SDHJ_AXES];
  const sdhj_status status = sdhj_seen(t, measurement, seen);
  uint32_t axis;
  memory->missed = 0;
  for (axis = 0; status == SDHJ_OK && axis < t->axes; axis++) {
    const double low = memory->low[axis], high = memory->high[axis], length = t->upper[axis] - t->lower[axis];
    const double far = (low < high ? 2.0 : 1.0) * t->error[axis] + 10.0 * t->slack[axis], x = seen[axis];
    double near = x, laps;
    volatile double turned;
    point[axis] = x;
    if (!memory->begun || (t->periodic[axis] && high - low >= length)) continue;
    if (t->periodic[axis]) {
      laps = (x - (low + high) / 2.0) / length + 0.5;
      turned = sdhj_between(laps, -1e9, 1e9) ? length * sdhj_floor(laps) : 0.0;
      near = x - turned;
    }
    memory->missed |= !sdhj_between(near, low - far, high + far);
    point[axis] = near < low ? low : near > high ? high : near;
  }
  if (status == SDHJ_OK && memory->missed) memcpy(point, seen, t->axes * sizeof *point);
  for (axis = 0; axis < t->axes; axis++) memory->low[axis] = 1e300, memory->high[axis] = -1e300; /* nothing is near */
  memory->begun = 1;
  return status != SDHJ_OK ? status : sdhj_place_of(t, point, place);
}

/* Note the input that is applied at a place until the next measurement, whatever it is. */
static inline void sdhj_applied(const sdhj_table *t, sdhj_memory *memory, uint32_t step, const sdhj_place *place, uint32_t input) {
  uint32_t cell[SDHJ_AXES], axis;
  int64_t first, last;
  memory->begun = t->leads > 0u && input < t->count_of_inputs && !(t->starts > 1u && step >= t->steps);
  if (!memory->begun) return;
  sdhj_claimed(t, step, place, input, cell);
  for (axis = 0; axis < t->axes; axis++) {
    sdhj_image(t, step, cell, input, axis, &first, &last);
    memory->low[axis] = sdhj_edge(t, axis, first), memory->high[axis] = sdhj_edge(t, axis, last + 1);
    if (first == last && ((t->layers[axis] & 1u && first == 0) || (t->layers[axis] & 2u && first == (int64_t)t->count[axis] - 1)))
      memory->low[axis] = memory->high[axis] = sdhj_behind(t, axis, first == 0);
  }
}

/* The input for a measurement; memory->missed says whether an assumption broke, and nothing is promised of this one. */
static inline sdhj_status sdhj_step(const sdhj_table *t, sdhj_memory *memory, uint32_t step, const double *measurement, uint32_t *input) {
  sdhj_place place;
  sdhj_status status = sdhj_remember(t, memory, measurement, &place);
  *input = t->brake;
  if (status != SDHJ_OK) return status;
  status = sdhj_select_at(t, step, &place, input);
  sdhj_applied(t, memory, step, &place, *input);
  return status;
}

/* The same of `sdhj_filter`. */
static inline sdhj_status sdhj_step_filter(const sdhj_table *t, sdhj_memory *memory, uint32_t step, const double *measurement, uint32_t wanted, uint32_t *input) {
  sdhj_place place;
  sdhj_status status = sdhj_remember(t, memory, measurement, &place);
  *input = t->brake;
  if (status != SDHJ_OK) return status;
  status = sdhj_filter_at(t, step, &place, wanted, NULL, input);
  sdhj_applied(t, memory, step, &place, *input);
  return status;
}

/* ---- the states that are kept in the table with their answers */

static inline uint32_t sdhj_told(uint32_t crc, sdhj_status status, uint32_t value) {
  uint8_t said[5];
  said[0] = (uint8_t)((int)status & 255);
  said[1] = (uint8_t)(value & 255u), said[2] = (uint8_t)(value >> 8 & 255u);
  said[3] = (uint8_t)(value >> 16 & 255u), said[4] = (uint8_t)(value >> 24);
  return sdhj_crc(crc, said, 5);
}

/* Play all of them: how many answers differ from those of Python, 0 where all is well. */
static inline uint32_t sdhj_selftest(const sdhj_table *t) {
  uint32_t i, axis, wrong = 0;
  for (i = 0; i < t->number_of_tests; i++) {
    const uint8_t *test = t->tests + (size_t)i * (2u * t->axes + 2u);
    const uint32_t step = t->starts > 1u ? i % (t->steps + 1u) : 0u;
    uint32_t value, crc = 0xffffffffu, j;
    double state[SDHJ_AXES];
    sdhj_status status, seen;
    sdhj_place place;
    for (axis = 0; axis < t->axes; axis++) { /* as a part of the axis, and a fiftieth past its ends */
      volatile double beside = 0.02 * t->length[axis], share = sdhj_u16(test + 2u * axis) * (1.04 / 65535.0);
      volatile double part = share * t->length[axis];
      state[axis] = t->lower[axis] - beside + part;
    }
    seen = sdhj_locate(t, state, &place); /* by cells, whether or not the table sees arrivals */
    value = UINT32_MAX;
    status = seen != SDHJ_OK ? seen : sdhj_steps_to_go_at(t, step, &place, &value);
    crc = sdhj_told(crc, status, value);
    value = t->brake;
    status = seen != SDHJ_OK ? seen : sdhj_select_at(t, step, &place, &value);
    crc = sdhj_told(crc, status, value);
    value = t->brake;
    status = seen != SDHJ_OK ? seen : sdhj_filter_at(t, step, &place, i % t->count_of_inputs, NULL, &value);
    crc = sdhj_told(crc, status, value);
    status = seen;
    for (j = 0; status == SDHJ_OK && j < 2u; j++) { /* inputs, one by one: there is no room for all of them */
      const uint32_t field = j == 0u ? SDHJ_SAFE : SDHJ_CLEAR;
      uint32_t input, cell[SDHJ_AXES], least;
      const sdhj_status ahead = sdhj_least_ahead(t, step, &place, &least);
      for (input = 0; (t->fields & field) && ahead != SDHJ_LAST_STEP && input < t->count_of_inputs; input++) {
        int proved = 0;
        memcpy(cell, place.first, sizeof cell);
        do {
          const uint8_t *word = sdhj_word(t, step, cell);
          if (field == SDHJ_CLEAR || sdhj_ahead(t, word) == least) proved |= sdhj_has(word + sdhj_offset(t, field), input);
        } while (sdhj_next(t, &place, cell));
        if (proved) crc = sdhj_told(crc, SDHJ_OK, input + j * 65536u);
      }
    }
    if (status == SDHJ_OK && t->leads > 0u && !(t->starts > 1u && step >= t->steps)) { /* what one of them leads to */
      uint32_t cell[SDHJ_AXES];
      int64_t first, last;
      sdhj_claimed(t, step, &place, i % t->count_of_inputs, cell);
      for (axis = 0; axis < t->axes; axis++) {
        sdhj_image(t, step, cell, i % t->count_of_inputs, axis, &first, &last);
        crc = sdhj_told(sdhj_told(crc, SDHJ_OK, (uint32_t)first), SDHJ_OK, (uint32_t)last);
      }
    }
    wrong += ((crc ^ 0xffffffffu) & 0xffffu) != sdhj_u16(test + 2u * t->axes);
  }
  return wrong;
}
#endif

#ifdef __cplusplus
static_assert(sizeof(uint32_t) == 4, "sdhj needs bytes of eight bits");
#endif
#endif
