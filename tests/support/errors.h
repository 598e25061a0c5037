// Errors checked by their text.
#pragma once

#include "base/error.h"

#include <gtest/gtest.h>
#include <string>

namespace haptrace::test {

/// The text of the Error that `call` throws, which must be of this kind; "no error" when it throws none.
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
