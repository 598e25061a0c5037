// Formulas of scene files: values, derivatives, bounds, and what is refused.
#include "scene/expression.h"

#include "base/error.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using test::error_of;
using testing::AllOf;
using testing::HasSubstr;

constexpr std::array<std::string_view, 3> kSpace{"x", "y", "z"};

Expression compiled(const std::string& text) {
  return {text, kSpace};
}

double number(const std::string& text, const Vec3& place = Vec3::Zero()) {
  return compiled(text + " + 0*x").value(place);
}

TEST(Expressions, FollowTheRulesOfArithmetic) {
  EXPECT_EQ(number("1 + 2 * 3"), 7);
  EXPECT_EQ(number("(1 + 2) * 3"), 9);
  EXPECT_EQ(number("2 - 3 - 4"), -5);
  EXPECT_EQ(number("64 / 4 / 2"), 8);
  EXPECT_EQ(number("2^3^2"), 512) << "to the right";
  EXPECT_EQ(number("-2^2"), -4) << "the power before the sign";
  EXPECT_EQ(number("2^-2"), 0.25);
  EXPECT_EQ(number("- -+3"), 3);
  EXPECT_EQ(number("1.5e-3 + .5 + 2."), 2.5015);
  EXPECT_EQ(number("2*e"), 2 * std::numbers::e);
  EXPECT_EQ(number("1e3*e"), 1000 * std::numbers::e);
  EXPECT_EQ(number("pi"), std::numbers::pi);
  const Vec3 p(0.3, -0.4, 1.2);
  EXPECT_EQ(number("x + 2*y - z/4", p), 0.3 - 0.8 - 0.3);
  EXPECT_NEAR(number("3 - x", p), 2.7, 1e-15);
  EXPECT_NEAR(number("3 / z - 1/(x-1)", p), 2.5 + 1 / 0.7, 1e-14);
  EXPECT_NEAR(number("x^3 + y^-1 + z^2.5 + z^x + 2^y", p),
              0.027 - 2.5 + std::pow(1.2, 2.5) + std::pow(1.2, 0.3) + std::pow(2, -0.4), 1e-14);
  EXPECT_NEAR(number("sin(x)+cos(y)+tan(z)+asin(x)+acos(y)+atan(z)", p),
              std::sin(0.3) + std::cos(-0.4) + std::tan(1.2) + std::asin(0.3) + std::acos(-0.4) + std::atan(1.2),
              1e-14);
  EXPECT_NEAR(number("exp(x) + log(z) + sqrt(z) + abs(y) + min(x, y) + max(x, y) + atan2(y, x)", p),
              std::exp(0.3) + std::log(1.2) + std::sqrt(1.2) + 0.4 - 0.4 + 0.3 + std::atan2(-0.4, 0.3), 1e-14);
}

/// Expressions that are smooth for x, y, z from 0.2 to 0.9, and use every function.
const std::vector<std::string> kSmooth{
    "x^2 + y^2 + z^2 - 0.03^2",
    "(sqrt(x^2 + y^2) - 0.5)^2 + z^2 - 0.01",
    "x*y*z - x/y + y/(z + 1)",
    "sin(3*x)*cos(2*y) + tan(z)",
    "asin(x) * acos(y) + atan(z/x)",
    "exp(-x*y) + log(x + z) * sqrt(y*z)",
    "x^3.3 + y^-2 + z^5 + x^y + 2^z + 1/x",
    "abs(x - 2*z - 3) + max(x, y - 3) + min(x*y, z + 5)",
    "atan2(y*z, x) + atan2(-y, -x - z)",
    "-(x - y)^2*3 + 7 - z",
};

TEST(Expressions, HaveTheGradientAndTheCurvatureOfTheirValue) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> side(0.2, 0.9);
  for (const std::string& text : kSmooth) {
    const Expression expression = compiled(text);
    for (int i = 0; i < 200; ++i) {
      const Vec3 place(side(random), side(random), side(random));
      const Jet jet = expression.jet(place);
      const Slope slope = expression.slope(place);
      ASSERT_NEAR(jet.value, expression.value(place), 1e-14 * (1 + std::abs(jet.value))) << text;
      ASSERT_EQ(slope.gradient, jet.gradient) << text;
      const double size = 1 + jet.vector().norm(), bend = 1 + jet.matrix().norm();
      for (int axis = 0; axis < 3; ++axis) {
        // A formula of the fourth order, so that the difference errs less than the bound.
        constexpr double kStep = 1e-3;
        const auto at = [&](double n) { return expression.jet(place + n * kStep * Vec3::Unit(axis)); };
        const Jet a = at(-2), b = at(-1), c = at(1), d = at(2);
        const double difference = (a.value - 8 * b.value + 8 * c.value - d.value) / (12 * kStep);
        ASSERT_NEAR(jet.vector()[axis], difference, 1e-7 * size) << text << " at " << place.transpose();
        const Vec3 row = (a.vector() - 8 * b.vector() + 8 * c.vector() - d.vector()) / (12 * kStep);
        ASSERT_LT((jet.matrix().col(axis) - row).norm(), 1e-6 * bend) << text << " at " << place.transpose();
      }
    }
  }
}

TEST(Expressions, AreWithinTheirBoundsOverABoxAndAlongALine) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> side(-1, 1), share(0, 1);
  std::vector<std::string> all = kSmooth;
  all.insert(all.end(), {"sin(20*x) + cos(31*y*z)", "tan(2*x)", "1/x", "log(x)", "sqrt(x*y)", "x^-3 + y^3 + z^4",
                         "abs(x) - abs(y)*z", "atan2(y, x)", "min(x, max(y, z)) * abs(x - y)"});
  int narrow = 0;
  for (const std::string& text : all) {
    const Expression expression = compiled(text);
    for (int i = 0; i < 400; ++i) {
      const double size = std::pow(10, -3 * share(random));
      const Vec3 from(side(random), side(random), side(random));
      const Vec3 way = size * Vec3(side(random), side(random), side(random));
      const auto range = [&](int axis) {
        return Interval{std::min(from[axis], from[axis] + way[axis]), std::max(from[axis], from[axis] + way[axis])};
      };
      const Interval box = expression.over(range(0), range(1), range(2));
      const Span line = expression.along(from, way, {0, 1});
      for (int j = 0; j < 20; ++j) {
        const Vec3 inside = from + way.cwiseProduct(Vec3(share(random), share(random), share(random)));
        if (const double value = expression.value(inside); !std::isnan(value)) {
          ASSERT_TRUE(box.has(value)) << text << " at " << inside.transpose();
        }
        const Slope on = expression.slope(from + share(random) * way);
        const double rate = on.vector().dot(way);
        if (std::isnan(on.value) || std::isnan(rate)) continue;
        const double noise = 1e-12 * (1 + std::abs(rate));
        ASSERT_TRUE(line.value.lo <= on.value && on.value <= line.value.hi) << text;
        ASSERT_TRUE(line.rate.lo <= rate + noise && rate - noise <= line.rate.hi) << text;
      }
      narrow += size < 0.01 && line.value.hi - line.value.lo < 1 ? 1 : 0;
    }
  }
  EXPECT_GT(narrow, 1000) << "the bounds say something";
}

TEST(Expressions, HaveNoDerivativeThatIsNotFiniteAtARootOfZero) {
  for (const char* text : {"sqrt(x^2 + y^2)", "(x^2 + y^2)^0.5", "abs(x)", "atan2(y, x)", "x^0 + y^1"}) {
    const Jet jet = compiled(text).jet(Vec3::Zero());
    EXPECT_TRUE(is_finite(jet.vector())) << text;
    EXPECT_TRUE(jet.matrix().allFinite()) << text;
  }
}

TEST(Expressions, SayTheColumnAndWhatIsKnown) {
  const auto error = [](const std::string& text) { return error_of([&] { (void)compiled(text); }); };
  EXPECT_THAT(error("x^2 + q"),
              AllOf(HasSubstr("column 7"), HasSubstr("unknown name 'q'"), HasSubstr("x, y, z, pi"), HasSubstr("sin")));
  EXPECT_THAT(error("x + sqr(y)"), AllOf(HasSubstr("column 5"), HasSubstr("did you mean 'sqrt'?")));
  EXPECT_THAT(error(""), AllOf(HasSubstr("column 1"), HasSubstr("ends")));
  EXPECT_THAT(error("x +"), AllOf(HasSubstr("column 4"), HasSubstr("ends")));
  EXPECT_THAT(error("2x"), AllOf(HasSubstr("column 2"), HasSubstr("2*x")));
  EXPECT_THAT(error("x y"), AllOf(HasSubstr("column 3"), HasSubstr("expected an operator")));
  EXPECT_THAT(error("(x + (y)"), AllOf(HasSubstr("column 9"), HasSubstr("')'"), HasSubstr("column 1")));
  EXPECT_THAT(error("x)"), AllOf(HasSubstr("column 2"), HasSubstr("no '('")));
  EXPECT_THAT(error("min(x)"), AllOf(HasSubstr("column 6"), HasSubstr("two arguments of min")));
  EXPECT_THAT(error("sin x"), AllOf(HasSubstr("column 5"), HasSubstr("after the function sin")));
  EXPECT_THAT(error("x + 1.2.3"), HasSubstr("column 8"));
  EXPECT_THAT(error("x $ y"), HasSubstr("column 3"));
  EXPECT_THAT(error("x + $"), AllOf(HasSubstr("column 5"), HasSubstr("'$'")));
  EXPECT_THAT(error("x + \xff"), HasSubstr("0xff"));
  EXPECT_THAT(error("x + 1e999"), HasSubstr("too large"));
  EXPECT_THAT(error("x^1e99"), HasSubstr("too large"));
  EXPECT_THAT(error("2 + pi"), AllOf(HasSubstr("no variable"), HasSubstr("x, y, z")));
}

TEST(Expressions, RefuseWhatIsNestedOrLongWithoutLimit) {
  const auto error = [](const std::string& text) { return error_of([&] { (void)compiled(text); }); };
  EXPECT_THAT(error(std::string(2000, '(') + "x" + std::string(2000, ')')), HasSubstr("nests deeper than"));
  std::string powers = "x", functions = "x", right = "x", terms = "x";
  for (int i = 0; i < 1000; ++i) powers += "^x";
  for (int i = 0; i < 800; ++i) functions = "sin(" + functions + ")";
  for (int i = 0; i < 40; ++i) right = "y+x*(" + right + ")";
  for (int i = 0; i < 1000; ++i) terms += "*y";
  EXPECT_THAT(error(powers), HasSubstr("nests deeper than"));
  EXPECT_THAT(error(functions), HasSubstr("nests deeper than"));
  EXPECT_THAT(error(right), HasSubstr("numbers at once"));
  EXPECT_THAT(error(terms), HasSubstr("more than 512 operations"));
  EXPECT_THAT(error("x" + std::string(5000, ' ')), HasSubstr("5001 characters"));
  EXPECT_NO_THROW((void)compiled(std::string(60, '(') + "x" + std::string(60, ')')));
}

TEST(Expressions, SurviveEveryText) {
  std::mt19937 random(3);
  const std::vector<std::string> words{"x",     "y",    "z",   "+",    "-",  "*",    "/",    "^",   "(",    ")", ",",
                                       "1",     ".",    "0.5", "e",    "pi", "sin",  "sqrt", "min", "max",  " ", "1e",
                                       "atan2", "log(", "q",   "\xff", "\t", "abs(", "1e9",  "(x)", "(y,z)"};
  std::uniform_int_distribution<std::size_t> word(0, words.size() - 1), length(1, 12);
  int valid = 0;
  for (int i = 0; i < 100'000; ++i) {
    std::string text;
    for (std::size_t n = length(random); n > 0; --n) text += words[word(random)];
    try {
      const Expression expression = compiled(text);
      ++valid;
      for (const Vec3& place : {Vec3(0, 0, 0), Vec3(0.1, -0.2, 0.3)}) {
        (void)expression.jet(place);
        const Interval box = expression.over({-1, 1}, {-1, 1}, {-1, 1});
        const double value = expression.value(place);
        ASSERT_TRUE(std::isnan(value) || box.has(value)) << text << ": " << value << " " << box.lo << " " << box.hi;
        (void)expression.along(place, Vec3::Ones(), {0, 1});
      }
    } catch (const Error& error) {
      ASSERT_TRUE(std::string(error.what()).find("olumn") != std::string::npos ||
                  std::string(error.what()).find("expression") != std::string::npos);
    }
  }
  EXPECT_GT(valid, 1000);
}

TEST(Expressions, AreEvaluatedWithoutAllocating) {
  const Expression expression = compiled(kSmooth[5]);
  const std::size_t before = test::allocations();
  double sum = 0;
  for (int i = 0; i < 100; ++i) {
    const Vec3 place(0.2 + 1e-3 * i, 0.3, 0.4);
    sum += expression.jet(place).value + expression.along(place, Vec3::Ones(), {0, 1e-3}).value.lo;
  }
  EXPECT_EQ(test::allocations(), before);
  EXPECT_NE(sum, 0);
}

TEST(Expressions, OfAMinimumOrMaximumSplitIntoTheirSides) {
  const auto sides = compiled("max(x*y - 1, min(z, 2*x))").split();
  ASSERT_TRUE(sides);
  EXPECT_FALSE(sides->least);
  const Vec3 p(0.3, 0.5, 0.7);
  EXPECT_NEAR(sides->a.value(p), 0.15 - 1, 1e-15);
  EXPECT_NEAR(sides->b.value(p), 0.6, 1e-15);
  ASSERT_TRUE(sides->b.split());
  EXPECT_TRUE(sides->b.split()->least);
  EXPECT_FALSE(compiled("max(x, y) + 1").split());
}

}  // namespace
}  // namespace haptrace
