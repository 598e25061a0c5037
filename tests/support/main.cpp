#include "tests/support/real_time.h"

int main(int argc, char** argv) {
  return haptrace::test::run_tests(argc, argv);
}
