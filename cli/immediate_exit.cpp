// _exit() and _Exit() for the plug-ins and drivers of this program: a motor must not keep its force because a library
// gave up.
#include "devices/loop/watchdog.h"

#include <sys/syscall.h>
#include <unistd.h>

extern "C" {

void _exit(int status) {
  haptrace::end_foreign_exit();
  while (true) syscall(SYS_exit_group, status);
}

void _Exit(int status) noexcept {
  haptrace::end_foreign_exit();
  while (true) syscall(SYS_exit_group, status);
}

}  // extern "C"
