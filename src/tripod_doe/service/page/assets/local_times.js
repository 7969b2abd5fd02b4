// Times in the zone of the reader; the server writes them in UTC.

const format = new Intl.DateTimeFormat([], { dateStyle: "medium", timeStyle: "short" });

export function localDay(at) {
  return new Date(at - 60000 * at.getTimezoneOffset()).toISOString().slice(0, 10);
}

export function timeElement(stamp) {
  const time = document.createElement("time");
  time.dateTime = time.title = stamp;
  time.textContent = format.format(new Date(stamp));
  return time;
}

export function localTimes(place) {
  for (const time of place.querySelectorAll("time[datetime]")) {
    if (!Number.isNaN(Date.parse(time.dateTime))) time.replaceWith(timeElement(time.dateTime));
  }
}

localTimes(document);
