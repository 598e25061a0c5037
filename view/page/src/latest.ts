// Asks one question at a time and forgets all but the newest of those that wait: a person who drags asks sixty
// times a second, and only the last place matters.
export class Latest<Question, Answer> {
  private waiting: Question | null = null;
  private asking: Question | null = null;
  private readonly ask: (question: Question) => Promise<Answer | null>;
  private readonly take: (question: Question, answer: Answer) => void;

  constructor(ask: (question: Question) => Promise<Answer | null>, take: (question: Question, answer: Answer) => void) {
    this.ask = ask;
    this.take = take;
  }

  get busy(): boolean {
    return this.asking !== null;
  }

  get outstanding(): Question | null {
    return this.asking;
  }

  request(question: Question): void {
    if (this.asking !== null) {
      this.waiting = question;
      return;
    }
    this.asking = question;
    const done = (answer: Answer | null): void => {
      this.asking = null;
      const next = this.waiting;
      this.waiting = null;
      if (answer !== null) this.take(question, answer);
      if (next !== null) this.request(next);
    };
    this.ask(question).then(done, () => done(null));
  }

  forget(): void {
    this.waiting = null;
  }
}
