// Library preloaded into a guardian: it sends the guardian's requests to usbfs to the emulated bus of the test.
#include "tests/devices/falcon/usb_client.h"

#include <cstdarg>
#include <dlfcn.h>
#include <unistd.h>

namespace {

haptrace::test::UsbClient& client() {
  static haptrace::test::UsbClient instance;
  return instance;
}

/// Registers the inherited port at once, since the bus forgets a file that no process has open any more.
__attribute__((constructor)) void adopt_port() {
  client().adopt(STDOUT_FILENO);
}

}  // namespace

extern "C" int ioctl(int fd, unsigned long request, ...) noexcept {
  va_list arguments;
  va_start(arguments, request);
  void* argument = va_arg(arguments, void*);
  va_end(arguments);
  int result = 0;
  if (client().handle(fd, request, argument, result)) return result;
  static const auto next = reinterpret_cast<int (*)(int, unsigned long, void*)>(dlsym(RTLD_NEXT, "ioctl"));
  return next(fd, request, argument);
}
