// Times in the zone of the reader; the server writes them in UTC.

const format = new Intl.DateTimeFormat([], { dateStyle: "medium", timeStyle: "short" });

export function localDay(at) {
  return new Date(at - 60000 * at.getTimezoneOffset()).toISOString().slice(0, 10);
}

export function localTimes(place) {
  for (const time of place.querySelectorAll("time[datetime]")) {
    const at = new Date(time.dateTime);
    if (Number.isNaN(at.getTime())) continue;
    time.title = time.dateTime;
    time.textContent = format.format(at);
  }
}

localTimes(document);
