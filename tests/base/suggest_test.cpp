#include "base/suggest.h"

#include <gtest/gtest.h>

namespace haptrace {
namespace {

const std::vector<std::string> kKeys{"stiffness", "damping", "mass", "kp", "kd"};

TEST(Nearest, FindsTheCandidateBehindOneTypingError) {
  EXPECT_EQ(nearest("stifness", kKeys), "stiffness");   // a letter missing
  EXPECT_EQ(nearest("dampping", kKeys), "damping");     // a letter too many
  EXPECT_EQ(nearest("masa", kKeys), "mass");            // another letter
  EXPECT_EQ(nearest("msas", kKeys), "mass");            // two letters swapped
  EXPECT_EQ(nearest("Stiffness", kKeys), "stiffness");  // another case
  EXPECT_EQ(nearest("pk", kKeys), "kp");
}

TEST(Nearest, FindsEveryCandidateItself) {
  for (const std::string& key : kKeys) EXPECT_EQ(nearest(key, kKeys), key);
}

TEST(Nearest, PrefersTheSmallerDistanceThenTheFirst) {
  EXPECT_EQ(nearest("kx", kKeys), "kp");
  EXPECT_EQ(nearest("dampin", std::vector<std::string>{"dumping", "damping"}), "damping");
}

TEST(Nearest, IsEmptyForAWordThatResemblesNone) {
  EXPECT_EQ(nearest("temperature", kKeys), "");
  EXPECT_EQ(nearest("", kKeys), "");
  EXPECT_EQ(nearest("q", std::vector<std::string>{"x"}), "");
  EXPECT_EQ(nearest("mass", std::vector<std::string>{}), "");
}

TEST(Suggestion, EndsAnErrorMessage) {
  EXPECT_EQ(suggestion("mas", kKeys), "; did you mean 'mass'?");
  EXPECT_EQ(suggestion("colour", kKeys), "; known: stiffness, damping, mass, kp, kd");
  EXPECT_EQ(suggestion("colour", std::vector<std::string>{}), "");
}

}  // namespace
}  // namespace haptrace
