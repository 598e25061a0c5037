// The contacts of one answer.
#pragma once

#include "scene/touch.h"

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

namespace haptrace {

/// A list of contacts whose memory is allocated beforehand. Copies between lists of the same capacity allocate nothing
/// and cost what the contacts in the list cost.
class ContactList {
 public:
  explicit ContactList(std::size_t capacity = 0) : contacts_(capacity) {}
  ContactList(const ContactList&) = default;
  ContactList(ContactList&&) = default;
  ContactList& operator=(ContactList&&) = default;
  ~ContactList() = default;
  ContactList& operator=(const ContactList& other) {
    if (this == &other) return *this;
    if (contacts_.size() < other.contacts_.size()) contacts_.resize(other.contacts_.size());
    std::copy_n(other.contacts_.begin(), other.count_, contacts_.begin());
    count_ = other.count_;
    return *this;
  }

  void clear() noexcept { count_ = 0; }
  /// Needs a free place.
  void add(const Contact& contact) noexcept { contacts_[count_++] = contact; }
  void assign(std::span<const Contact> contacts) noexcept {
    clear();
    for (const Contact& contact : contacts) add(contact);
  }

  [[nodiscard]] std::span<const Contact> all() const noexcept { return {contacts_.data(), count_}; }
  /// Returns the contact with an object of the scene; null if the list has none.
  [[nodiscard]] const Contact* find(std::uint32_t object) const noexcept {
    const auto list = all();
    const auto found =
        std::find_if(list.begin(), list.end(), [&](const Contact& contact) { return contact.object == object; });
    return found == list.end() ? nullptr : &*found;
  }

 private:
  std::vector<Contact> contacts_;
  std::size_t count_ = 0;
};

}  // namespace haptrace
