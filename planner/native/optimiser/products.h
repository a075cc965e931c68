/* How a call of fatrop that does not return is left. See products.c. */

#include <setjmp.h>

extern _Thread_local int products __attribute__((visibility("hidden")));   /* since the last derivatives */
extern _Thread_local jmp_buf *leave __attribute__((visibility("hidden"))); /* set where a call may be left */
