"""Who watches a benchmark in the tests."""


class Seen:
    """A watcher that writes everything down."""

    def __init__(self):
        self.begun, self.words, self.count = [], [], 0

    def begin(self, what, total, done):
        self.begun.append((what, total, done))

    def landed(self, what):
        self.count += 1

    def say(self, words):
        self.words.append(words)
