#include "tests/cli/command.h"

#include <csignal>
#include <future>
#include <gtest/gtest.h>
#include <pty.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

namespace haptrace::test {
namespace {

std::string drain(int fd) {
  std::string text;
  char buffer[4096];
  for (ssize_t n = 0; (n = read(fd, buffer, sizeof buffer)) > 0;) text.append(buffer, static_cast<std::size_t>(n));
  close(fd);
  return text;
}

}  // namespace

nlohmann::json Answer::json() const {
  nlohmann::json parsed = nlohmann::json::parse(out, nullptr, false);
  EXPECT_FALSE(parsed.is_discarded()) << "not JSON: " << out << err;
  return parsed;
}

Command::Command(const std::vector<std::string>& arguments, Input input, const std::vector<std::string>& environment,
                 const std::string& program) {
  int in[2] = {-1, -1}, out[2], err[2] = {-1, -1};
  if (pipe(out) != 0) throw std::runtime_error("no pipe");
  if (input != Input::terminal && pipe(err) != 0) throw std::runtime_error("no pipe");
  if (input == Input::pipe && pipe(in) != 0) throw std::runtime_error("no pipe");
  int terminal = -1;
  pid_ = input == Input::terminal ? forkpty(&terminal, nullptr, nullptr, nullptr) : fork();
  if (pid_ == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);  // a session without an end fills the disk when its test is killed
    // A shell starts what it runs in the background with these ignored, and a test that interrupts would wait for ever.
    for (const int ignored : {SIGINT, SIGQUIT}) std::signal(ignored, SIG_DFL);
    dup2(out[1], STDOUT_FILENO);
    if (input != Input::terminal) dup2(err[1], STDERR_FILENO);
    if (input == Input::pipe) dup2(in[0], STDIN_FILENO);
    for (const int fd : {in[0], in[1], out[0], out[1], err[0], err[1]})
      if (fd >= 0) close(fd);
    std::vector<char*> argv{const_cast<char*>(program.c_str())};
    for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    // Keep the user's own profiles out of the tests.
    setenv("HAPTRACE_PROFILES", "/nonexistent/haptrace/profiles", 1);
    for (const std::string& variable : environment) putenv(const_cast<char*>(variable.c_str()));
    execv(program.c_str(), argv.data());
    _exit(127);
  }
  close(out[1]);
  out_ = out[0];
  if (input == Input::terminal) {
    err_ = terminal;
    in_ = dup(terminal);
  } else {
    close(err[1]);
    err_ = err[0];
  }
  if (input == Input::pipe) {
    close(in[0]);
    in_ = in[1];
  }
}

void Command::type(const std::string& text) const {
  EXPECT_EQ(write(in_, text.data(), text.size()), static_cast<ssize_t>(text.size()));
}

void Command::hang_up() {
  for (int* descriptor : {&in_, &err_})
    if (*descriptor >= 0) close(std::exchange(*descriptor, -1));
}

Command::~Command() {
  if (pid_ > 0) {
    kill(pid_, SIGKILL);
    wait();
  }
}

bool Command::says(std::string_view part) {
  char character = 0;
  while (said_.find(part) == std::string::npos && read(err_, &character, 1) == 1) said_ += character;
  return said_.find(part) != std::string::npos;
}

std::string Command::word_after(std::string_view part) const {
  const std::size_t found = said_.find(part);
  if (found == std::string::npos) return {};
  const std::size_t begin = found + part.size();
  return said_.substr(begin, said_.find_first_of(" \r\n", begin) - begin);
}

Answer Command::wait() {
  Answer answer;
  auto out = std::async(std::launch::async, drain, out_);
  answer.err = said_ + drain(err_);
  answer.out = out.get();
  if (in_ >= 0) close(std::exchange(in_, -1));
  int status = 0;
  waitpid(pid_, &status, 0);
  pid_ = -1;
  answer.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  return answer;
}

}  // namespace haptrace::test
