/* SPDX-License-Identifier: GPL-3.0-or-later
 * Call each kernel with what replay_elsewhere.py wrote, without Python.
 * usage: replay LIBRARY CALLS      (with -DTABLE: linked with the kernels, and LIBRARY is unused) */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef TABLE
typedef int call(void *, void *, void *);
extern struct { const char *name; call *function; } table[];
static void *open_library(const char *path) { return (void *)path; }
static call *find(void *library, const char *name) {
    for (int i = 0; table[i].name; i++)
        if (!strcmp(table[i].name, name)) return table[i].function;
    return NULL;
}
#elif defined(_WIN32)
#include <windows.h>
typedef int call(void *, void *, void *);
static void *open_library(const char *path) { return LoadLibraryA(path); }
static call *find(void *library, const char *name) { return (call *)GetProcAddress(library, name); }
#else
#include <dlfcn.h>
typedef int call(void *, void *, void *);
static void *open_library(const char *path) { return dlopen(path, RTLD_NOW); }
static call *find(void *library, const char *name) { return (call *)dlsym(library, name); }
#endif

static FILE *file;
static int64_t number(void) {
    int64_t value = -1;
    if (fread(&value, 8, 1, file) != 1) value = -1;
    return value;
}
static char *bytes(int64_t size) {
    char *data = malloc(size + 64);
    if (fread(data, 1, size, file) != (size_t)size) exit(2);
    return data;
}

static double worst(const char *a, const char *b, int64_t size, int64_t kind) {
    double most = 0, scale = 1e-300;
    if (kind == 1) return memcmp(a, b, size) ? INFINITY : 0;
    for (int64_t i = 0; i < size; i += kind) {
        double x = kind == 8 ? *(double *)(a + i) : *(float *)(a + i);
        double y = kind == 8 ? *(double *)(b + i) : *(float *)(b + i);
        if (fabs(y) < INFINITY) scale = fmax(scale, fabs(y));
        if (!(x == y || (x != x && y != y))) most = fmax(most, x - y == x - y ? fabs(x - y) : INFINITY);
    }
    return most / scale;
}

int main(int count, char **given) {
    void *library = open_library(given[1]);
    if (!library) return puts("cannot load the library"), 1;
    file = fopen(given[2], "rb");
    int same = 0, close = 0, other = 0, missing = 0, failed = 0;
    for (int64_t length; (length = number()) > 0;) {
        char name[64] = {0};
        memcpy(name, bytes(length), length);
        int64_t slots[512], which[512], slot_count = number(), array_count;
        for (int i = 0; i < slot_count; i++) which[i] = number(), slots[i] = number();
        array_count = number();
        char *data[256], *after[256];
        int64_t sizes[256], kinds[256];
        for (int i = 0; i < array_count; i++) {
            kinds[i] = number(), sizes[i] = number();
            data[i] = bytes(sizes[i]), after[i] = bytes(sizes[i]);
        }
        for (int i = 0; i < slot_count; i++)
            if (which[i] >= 0) slots[i] = (int64_t)(intptr_t)data[which[i]];
        int64_t result[64] = {0}, expected_size = number();
        char *expected = expected_size > 0 ? bytes(expected_size) : NULL;
        void *error = NULL;
        call *function = find(library, name);
        if (!function) { missing++; continue; }
        int status = function(slots, result, &error);
        if (status) { failed++; printf("%s: status %d\n", name, status); continue; }
        double most = 0;
        int equal = expected_size <= 0 || !memcmp(result, expected, expected_size);
        for (int i = 0; i < array_count; i++) {
            equal &= !memcmp(data[i], after[i], sizes[i]);
            most = fmax(most, worst(data[i], after[i], sizes[i], kinds[i]));
        }
        if (equal) same++;
        else if (most < 1e-5) close++;
        else other++, printf("%s: differs by %g\n", name, most);
    }
    printf("same bits %d, to 1e-5 %d, farther %d, missing %d, failed %d\n", same, close, other, missing, failed);
    return other || missing || failed;
}
