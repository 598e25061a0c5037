const quarterSecond = (): Promise<void> => new Promise((resolve) => setTimeout(resolve, 250));

// Asks one question at a time and forgets all but the newest of those that wait: a person who drags asks sixty
// times a second, and only the last place matters.
export class Latest<Question, Answer> {
  private waiting: Question | null = null;
  private asking: Question | null = null;
  private paused = false;
  private readonly pause: () => Promise<void>;
  private readonly ask: (question: Question) => Promise<Answer | null>;
  private readonly take: (question: Question, answer: Answer) => void;

  // `ask` gives null if there is no answer; the next question then waits for `pause`, so that a server that refuses is not
  // asked in every frame.
  constructor(ask: (question: Question) => Promise<Answer | null>, take: (question: Question, answer: Answer) => void, pause = quarterSecond) {
    this.ask = ask;
    this.take = take;
    this.pause = pause;
  }

  get busy(): boolean {
    return this.asking !== null;
  }

  get outstanding(): Question | null {
    return this.asking;
  }

  request(question: Question): void {
    if (this.asking !== null || this.paused) {
      this.waiting = question;
      return;
    }
    this.asking = question;
    const done = (answer: Answer | null): void => {
      this.asking = null;
      if (answer !== null) {
        this.take(question, answer);
        this.next();
        return;
      }
      this.paused = true;
      void this.pause().then(() => {
        this.paused = false;
        this.next();
      });
    };
    this.ask(question).then(done, () => done(null));
  }

  private next(): void {
    const next = this.waiting;
    this.waiting = null;
    if (next !== null) this.request(next);
  }

  forget(): void {
    this.waiting = null;
  }
}
