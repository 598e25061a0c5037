// Helper to check errors by their text.
#pragma once

#include "base/error.h"

#include <gtest/gtest.h>
#include <string>

namespace haptrace::test {

/// Returns the text of the Error that `call` throws, or "no error". Fails the test if the Error is of another kind.
template <class Call>
std::string error_of(const Call& call, Error::Kind kind = Error::Kind::input) {
  try {
    call();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind) << error.what();
    return error.what();
  }
  return "no error";
}

}  // namespace haptrace::test
